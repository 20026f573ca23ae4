// Dynamic cores: P maps a core's twist to the velocities of the nodes it carries, v = u + w x arm; P^T sums their forces.
// Needs `node_rest` and shared/rotation.glsl.

// From a carried node's core, turned by `rotation`, to the node, world axes.
vec3 arm_of(uint node, vec4 rotation) { return rotate(rotation, fetch(node_rest, node).xyz); }

vec3 carry(float twist[6], vec3 arm) {
    return vec3(twist[0], twist[1], twist[2]) + cross(vec3(twist[3], twist[4], twist[5]), arm);
}
