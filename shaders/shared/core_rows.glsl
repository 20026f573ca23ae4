// The six rows of each dynamic core. Needs `cores`, `core_nodes`, `image`, shared/core.glsl, shared/sum.glsl and SIZE.

// What of a force and a torque a core follows: on a hinge, through its centre and at rest, only the torque about that.
float[6] followed(uint core, vec3 force, vec3 torque) {
    vec3 axis = cores[core].hinge;
    if (axis != vec3(0.0)) {
        force = vec3(0.0);
        torque = dot(axis, torque) * axis;
    }
    return float[6](force.x, force.y, force.z, torque.x, torque.y, torque.z);
}

// P^T w of a core, w = A p at the nodes it carries; every lane gets it. Their inertia is in w, and so the core's.
float[6] core_image(uint core) {
    vec3 linear = vec3(0.0), angular = vec3(0.0);
    for (uint k = gl_LocalInvocationID.x; k < cores[core].node_count; k += SIZE) {
        uint node = core_nodes[cores[core].node_first + k];
        vec3 w = texelFetch(image, int(node)).xyz;
        linear += w;
        angular += cross(arm_of(node, cores[core].frame), w);
    }
    linear = workgroup_sum(vec4(linear, 0.0)).xyz;
    angular = workgroup_sum(vec4(angular, 0.0)).xyz;
    return followed(core, linear, angular);
}
