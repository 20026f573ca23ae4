// Motion of nodes attached to a dynamic core (rigid core inside a soft body, whose motion the solver finds): the matrix
// P maps a core's twist (u, w) to the velocities of its nodes, v = u + w x arm; P^T sums forces on these nodes to a
// force and a torque. An including shader declares `node_rest` and includes shared/rotation.glsl.

// Arm of an attached node: the vector from its core's centre to it, in world axes; `rotation` is the core's.
vec3 arm_of(uint node, vec4 rotation) { return rotate(rotation, fetch(node_rest, node).xyz); }

vec3 carry(float twist[6], vec3 arm) {
    return vec3(twist[0], twist[1], twist[2]) + cross(vec3(twist[3], twist[4], twist[5]), arm);
}
