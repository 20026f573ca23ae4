// Joints between two rigid bodies, the joint's sides 0 and 1, at least one of which is a dynamic core (rigid body
// inside a soft body, whose motion the solver finds). An including shader declares `joints` and `joint_sides`, which
// lists the joints of each core as 2 * joint + side.

// Adds a joint's part of the operator product: the change of velocity `linear` and of angular velocity `angular` of the
// body on side `from`, times the joint's rows of the operator for the body on side `to`.
void add_joint(uint joint, uint to, uint from, vec3 linear, vec3 angular, inout vec3 force, inout vec3 torque) {
    float sign = to == from ? 1.0 : -1.0, w[6] = joints[joint].angular;
    vec3 along = sign * joints[joint].linear * (linear + cross(angular, joints[joint].arm[from]));
    vec3 about = vec3(w[0] * angular.x + w[3] * angular.y + w[4] * angular.z,
        w[3] * angular.x + w[1] * angular.y + w[5] * angular.z, w[4] * angular.x + w[5] * angular.y + w[2] * angular.z);
    force += along;
    torque += cross(joints[joint].arm[to], along) + sign * about;
}

// Adds the impulses of a joint's springs to the right-hand side of the body on one of its sides.
void add_springs(uint joint, uint side, inout vec3 force, inout vec3 torque) {
    float sign = side == 0 ? 1.0 : -1.0;
    vec3 along = sign * joints[joint].impulse;
    force += along;
    torque += cross(joints[joint].arm[side], along) + sign * joints[joint].twist;
}
