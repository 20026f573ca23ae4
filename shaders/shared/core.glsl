// Motion of nodes attached to a dynamic core (rigid body inside a soft body, whose motion the solver finds): a node has
// the velocity v = u + w x arm, with the core's velocity u and angular velocity w, together its twist, and the vector
// `arm` from the core's centre to the node. An including shader declares `node_rest` and includes shared/rotation.glsl.

// Arm of an attached node in world axes, m; `rotation` is the core's.
vec3 arm_of(uint node, vec4 rotation) { return rotate(rotation, fetch(node_rest, node).xyz); }

// Velocity of an attached node, from the twist of its core.
vec3 carry(float twist[6], vec3 arm) {
    return vec3(twist[0], twist[1], twist[2]) + cross(vec3(twist[3], twist[4], twist[5]), arm);
}
