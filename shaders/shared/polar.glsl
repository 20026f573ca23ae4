// Polar decomposition: the rotation R nearest to a matrix F, by iteration from a guess. Each round turns R by a
// rotation vector w. Where the symmetric part S of R^T F is far from singular, w is Newton's step to a symmetric R^T F:
// (tr(S) I - S) w = axial(R^T F), where axial(A) is the vector (A32 - A23, A13 - A31, A21 - A12). This step converges
// quadratically; from the rotation of the last time step one round mostly suffices. Elsewhere w = axial(R^T F) /
// |tr(R^T F)| (Mueller et al. 2016, "A Robust Method to Extract the Rotational Part of Deformations"); this slow step
// converges linearly, but also where F is inverted (det F < 0), and R stays a proper rotation. An including shader
// includes shared/rotation.glsl.

const uint POLAR_ROUNDS = 40;           // greatest number of rounds
const float NEWTON_DONE = 1.0e-4;       // a smaller Newton step is the last, rad; the error left is about its square
const float POLAR_DONE = 1.0e-7;        // a smaller slow step is not taken, and ends the iteration, rad
const float POLAR_LOST = 1.0e-5;        // after a larger step in the last round the rotation is lost, rad

mat3 matrix_of(vec4 q) {
    return mat3(rotate(q, vec3(1, 0, 0)), rotate(q, vec3(0, 1, 0)), rotate(q, vec3(0, 0, 1)));
}

// Rotation nearest to `f`, from the guess `q`; `lost`: whether the rotation was not found within POLAR_ROUNDS rounds.
vec4 polar(mat3 f, vec4 q, out bool lost) {
    lost = false;
    for (uint k = 0; k < POLAR_ROUNDS; k++) {
        mat3 m = transpose(matrix_of(q)) * f;
        vec3 axial = vec3(m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]);
        // `d` and `o` are the diagonal and the off-diagonal entries (yz, xz, xy) of the matrix tr(S) I - S; `minor` and
        // `across` are those of its adjugate.
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
