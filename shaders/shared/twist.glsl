// Six numbers (force and torque, in world axes) of a rigid core from the sums over the modes of its blocks of attached
// nodes. An including shader includes shared/rotation.glsl.

// twist_of_<array>(first, count, turn) sums the first six modes of `count` blocks from index `first` on in the buffer
// <array>, and rotates the sums (linear, angular) to world axes by the body's rotation `turn`.
#define TWIST_OF(array) \
    float[6] twist_of_##array(uint first, uint count, vec4 turn) { \
        vec3 linear = vec3(0.0), angular = vec3(0.0); \
        for (uint b = first; b < first + count; b++) { \
            add_modes(linear, angular, fetch(array, 3 * b), fetch(array, 3 * b + 1)); \
        } \
        return turned_twist(linear, angular, turn); \
    }

// Adds the first six numbers of a block's modes, which are in the first two of its texels.
void add_modes(inout vec3 linear, inout vec3 angular, vec4 low, vec4 high) {
    linear += low.xyz;
    angular += vec3(low.w, high.xy);
}

float[6] turned_twist(vec3 linear, vec3 angular, vec4 turn) {
    linear = rotate(turn, linear);
    angular = rotate(turn, angular);
    return float[6](linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
}
