// The part of a force and torque that can move a core: all, or, on a hinge through its centre, the torque about it.

void follow(vec3 hinge, inout vec3 force, inout vec3 torque) {
    if (hinge != vec3(0.0)) {
        force = vec3(0.0);
        torque = dot(hinge, torque) * hinge;
    }
}
