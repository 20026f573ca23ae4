// Estimate of the energy e . A e (J) of a solution's error e in conjugate gradients on A x = b. Each iteration makes it
// smaller by alpha gamma (Hestenes and Stiefel 1952). The sum over the last four iterations estimates, from below, what
// it was before these (Strakos and Tichy 2002); it is more than the present value if these iterations have halved it.
// Before four iterations are done the estimate means nothing. An including shader includes shared/types.glsl first.

const uint ERROR_DELAY = 4;     // number of iterations over which the estimate sums

float error_energy(Iteration last) {
    vec4 e = last.energies;
    return e.x + e.y + e.z + e.w;
}
