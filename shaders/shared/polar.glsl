// The rotation nearest to a matrix F, from a guess. Where R^T F has a symmetric part S that is far from singular, Newton's
// step to a symmetric R^T F, (tr(S) I - S) w = axial(R^T F), which converges quadratically: from the last step's rotation
// mostly one round. Elsewhere the step of Mueller et al. 2016, "A Robust Method to Extract the Rotational Part of
// Deformations", w = axial(R^T F) / |tr(R^T F)|: slower, but proper and steady under inversion. Needs shared/rotation.glsl.

const uint POLAR_ROUNDS = 40;
const float NEWTON_DONE = 1.0e-4;       // rad; what is left after such a step is its square
const float POLAR_DONE = 1.0e-7;        // rad; f32 resolves no less
const float POLAR_LOST = 1.0e-5;        // rad; who still turns by this after all rounds is not there: slow ones have far to go

mat3 matrix_of(vec4 q) {
    return mat3(rotate(q, vec3(1, 0, 0)), rotate(q, vec3(0, 1, 0)), rotate(q, vec3(0, 0, 1)));
}

vec4 polar(mat3 f, vec4 q, out bool lost) {
    lost = false;
    for (uint k = 0; k < POLAR_ROUNDS; k++) {
        mat3 m = transpose(matrix_of(q)) * f;
        vec3 axial = vec3(m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]);
        // h = tr(S) I - S: diagonal `d`, off the diagonal `o` (yz, xz, xy); its adjugate the same way.
        vec3 d = vec3(m[1][1] + m[2][2], m[0][0] + m[2][2], m[0][0] + m[1][1]);
        vec3 o = -0.5 * vec3(m[1][2] + m[2][1], m[0][2] + m[2][0], m[0][1] + m[1][0]);
        vec3 minor = d.yzx * d.zxy - o * o, across = o.yzx * o.zxy - o * d;
        float determinant = d.x * minor.x + o.z * across.z + o.y * across.y;
        float trace = m[0][0] + m[1][1] + m[2][2];
        bool newton = d.x > 0.0 && minor.z > 0.0 && determinant > 0.05 * trace * trace * trace && trace > 0.0;
        vec3 turn = vec3(minor.x * axial.x + across.z * axial.y + across.y * axial.z,
            across.z * axial.x + minor.y * axial.y + across.x * axial.z,
            across.y * axial.x + across.x * axial.y + minor.z * axial.z);
        vec3 omega = newton ? turn / determinant : axial / (abs(trace) + 1.0e-9);
        float angle2 = dot(omega, omega), done = newton ? NEWTON_DONE : POLAR_DONE;
        if (!newton && angle2 < done * done) break;
        q = normalize(compose(q, vec4(0.5 * omega, 1.0)));
        if (newton && angle2 < done * done) break;
        lost = k == POLAR_ROUNDS - 1 && angle2 > POLAR_LOST * POLAR_LOST;
    }
    return q;
}
