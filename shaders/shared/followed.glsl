// Reduces a force and a torque to the part that can move a rigid core (rigid body inside a soft body). A free core is
// moved by all of both; a core that turns on a hinge through its centre only by the torque about the hinge's axis.
// `hinge` is the unit vector along this axis, or zero for a free core.

void follow(vec3 hinge, inout vec3 force, inout vec3 torque) {
    if (hinge != vec3(0.0)) {
        force = vec3(0.0);
        torque = dot(hinge, torque) * hinge;
    }
}
