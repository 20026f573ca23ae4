// Two estimates of the energy e . A e (J) of a solution's error e in conjugate gradients on A x = b: before the last four
// iterations, and after the last. Each iteration makes it smaller by alpha gamma (Hestenes and Stiefel 1952). The sum over
// the last four iterations estimates, from below, what it was before these (Strakos and Tichy 2002); it is more than the
// present value if these iterations have halved it. Before four iterations are done since the search directions began
// anew the estimate means nothing. An including shader includes shared/types.glsl first.

const uint ERROR_DELAY = 4;     // number of iterations over which the estimate sums
// Greatest error at which a solver without a tolerance stops, as a share of the energy of the difference of this step's
// change of velocity from the last step's. Half that difference is what one step of implicit Euler differs from the
// trapezoidal rule: the local error of the time step. The solver's error is to be a twentieth of that half.
const float STEP_ERROR_SHARE = 1.0 / (4.0 * 20.0 * 20.0);

float error_energy(Iteration last) {
    vec4 e = last.energies;
    return e.x + e.y + e.z + e.w;
}

// Estimate of e . A e after the last iteration, J. What each further iteration removes is taken to be that of the one
// before, times the greatest ratio of two successive ones among the last four. UNLIMITED where one rose, or where fewer
// than ERROR_DELAY iterations are done since the search directions began anew.
float error_energy_left(Iteration last) {
    vec4 e = last.energies;
    float ratio = max(max(e.x / e.y, e.y / e.z), e.z / e.w);
    return last.fresh >= ERROR_DELAY && ratio < 1.0 ? e.x * ratio / (1.0 - ratio) : UNLIMITED;
}
