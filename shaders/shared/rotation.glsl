// Functions on rotations, which are kept as unit quaternions x y z w.

vec3 rotate(vec4 q, vec3 p) { return p + 2.0 * cross(q.xyz, cross(q.xyz, p) + q.w * p); }

vec3 rotate_back(vec4 q, vec3 p) { return p + 2.0 * cross(q.xyz, cross(q.xyz, p) - q.w * p); }

// Quaternion of a rotation vector, rad.
vec4 turn_by(vec3 turn) {
    float angle = length(turn);
    return vec4(turn * (angle > 1.0e-6 ? sin(0.5 * angle) / angle : 0.5), cos(0.5 * angle));
}

vec4 compose(vec4 a, vec4 b) {
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}
