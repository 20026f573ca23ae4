// Six numbers of a rigid body in the solver, summed over its blocks: a force and a torque about the body's centre, or a
// linear and an angular velocity, in world axes. A block is a set of nodes that one workgroup works on. Kernels store
// twelve numbers for each block, in three vec4; the first six are the block's part of the linear and of the angular
// vector, in the axes of the body. An including shader includes shared/rotation.glsl.

// twist_of_<array>(first, count, turn) sums the first six numbers of `count` blocks, from index `first` on in the
// buffer <array>, and rotates the two sums (linear, angular) to world axes by the body's rotation `turn`.
#define TWIST_OF(array) \
    float[6] twist_of_##array(uint first, uint count, vec4 turn) { \
        vec3 linear = vec3(0.0), angular = vec3(0.0); \
        for (uint b = first; b < first + count; b++) { \
            add_modes(linear, angular, fetch(array, 3 * b), fetch(array, 3 * b + 1)); \
        } \
        return turned_twist(linear, angular, turn); \
    }

// Adds the first six numbers of a block, which are in the block's first two vec4, `low` and `high`.
void add_modes(inout vec3 linear, inout vec3 angular, vec4 low, vec4 high) {
    linear += low.xyz;
    angular += vec3(low.w, high.xy);
}

float[6] turned_twist(vec3 linear, vec3 angular, vec4 turn) {
    linear = rotate(turn, linear);
    angular = rotate(turn, angular);
    return float[6](linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
}
