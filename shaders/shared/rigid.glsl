// Rows of rigid bodies. Needs `params`, `frames`, `rigids`, `iterates`, `solve`, `restricted_image`, BLOCKS, RIGIDS, TOOL,
// shared/rotation.glsl and shared/six.glsl.

// A rigid body's twist from sums over its blocks of modes, world axes.
float[6] twist_of(samplerBuffer modes, uint first, uint count, vec4 turn) {
    vec3 linear = vec3(0.0), angular = vec3(0.0);
    for (uint b = first; b < first + count; b++) {
        vec4 low = texelFetch(modes, int(3 * b)), high = texelFetch(modes, int(3 * b + 1));
        linear += low.xyz;
        angular += vec3(low.w, high.xy);
    }
    linear = rotate(turn, linear);
    angular = rotate(turn, angular);
    return float[6](linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
}

// A x of the newest solution, in the rows of a rigid body.
float[6] image_of(uint index) {
    bool is_tool = TOOL && index == RIGIDS - 1;
    uint first = is_tool ? BLOCKS : rigids[index].slot_first, count = is_tool ? 1 : rigids[index].block_count;
    vec4 turn = is_tool ? vec4(0.0, 0.0, 0.0, 1.0) : frames[rigids[index].frame].rotation;
    float y[6] = twist_of(restricted_image, first, count, turn);
    if (is_tool) {
        float own[6] = times(params.tool_matrix, iterates[solve.current * RIGIDS + index].x);
        for (int k = 0; k < 6; k++) y[k] += own[k];
    }
    return y;
}
