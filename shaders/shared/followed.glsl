// What of a force and a torque a core follows: on a hinge, through its centre and at rest, only the torque about that.

void follow(vec3 hinge, inout vec3 force, inout vec3 torque) {
    if (hinge != vec3(0.0)) {
        force = vec3(0.0);
        torque = dot(hinge, torque) * hinge;
    }
}
