// The part of a force and torque that can move a rigid core: all of it for a free core; for a core that turns on a
// hinge through its centre (`hinge` is the unit axis, zero without a hinge) only the torque about that axis.

void follow(vec3 hinge, inout vec3 force, inout vec3 torque) {
    if (hinge != vec3(0.0)) {
        force = vec3(0.0);
        torque = dot(hinge, torque) * hinge;
    }
}
