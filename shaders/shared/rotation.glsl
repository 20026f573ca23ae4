// Functions on rotations, which are kept as unit quaternions x y z w.

vec3 rotate(vec4 q, vec3 p) { return p + 2.0 * cross(q.xyz, cross(q.xyz, p) + q.w * p); }

vec3 rotate_back(vec4 q, vec3 p) { return p + 2.0 * cross(q.xyz, cross(q.xyz, p) - q.w * p); }

// Quaternion of a rotation vector, rad. Vulkan allows sin() and cos() an error of 2^-11, so these are Taylor series of
// half the angle, which are exact to rounding up to an angle of 1 rad; a larger angle is halved first, and the quaternion
// squared as often.
vec4 turn_by(vec3 turn) {
    vec3 part = 0.5 * turn;
    uint halvings = 0;
    for (; dot(part, part) > 0.25 && halvings < 32; halvings++) part *= 0.5;
    float a = dot(part, part);
    float s = 1.0 - a / 6.0 * (1.0 - a / 20.0 * (1.0 - a / 42.0 * (1.0 - a / 72.0)));
    float c = 1.0 - a / 2.0 * (1.0 - a / 12.0 * (1.0 - a / 30.0 * (1.0 - a / 56.0)));
    vec4 q = vec4(s * part, c);
    for (uint k = 0; k < halvings; k++) q = vec4(2.0 * q.w * q.xyz, q.w * q.w - dot(q.xyz, q.xyz));
    return q;
}

vec4 compose(vec4 a, vec4 b) {
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}
