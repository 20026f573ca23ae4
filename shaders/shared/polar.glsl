// The rotation nearest to a matrix, by Mueller et al. 2016, "A Robust Method to Extract the Rotational Part of Deformations":
// started at a guess, proper, and steady under inversion. Needs shared/rotation.glsl.

const uint POLAR_ROUNDS = 40;
const float POLAR_DONE = 1.0e-7;        // rad; f32 resolves no less

mat3 matrix_of(vec4 q) {
    return mat3(rotate(q, vec3(1, 0, 0)), rotate(q, vec3(0, 1, 0)), rotate(q, vec3(0, 0, 1)));
}

vec4 polar(mat3 f, vec4 q) {
    for (uint k = 0; k < POLAR_ROUNDS; k++) {
        mat3 r = matrix_of(q);
        vec3 turn = cross(r[0], f[0]) + cross(r[1], f[1]) + cross(r[2], f[2]);
        float scale = abs(dot(r[0], f[0]) + dot(r[1], f[1]) + dot(r[2], f[2])) + 1.0e-9;
        vec3 omega = turn / scale;
        float angle = length(omega);
        if (angle < POLAR_DONE) break;
        q = normalize(compose(vec4(omega * (sin(0.5 * angle) / angle), cos(0.5 * angle)), q));
    }
    return q;
}
