// Rows of rigid bodies from sums over modes. Needs shared/rotation.glsl.

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
