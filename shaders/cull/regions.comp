#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull: one region a pair of bodies. Its normal is the weighted mean of its active proxies' directions, its tile what both
// sides' active hulls cover in common along the tangents; then the list of active proxies in fixed order, and the indirect
// arguments of everything downstream. One workgroup. Oracle: oracle::proximity::mean_direction and side_box.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint PAIRS = 1;
layout(constant_id = 2) const uint TILE = 128;              // texels a side at most

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Pairs { Pair pairs[]; };
layout(scalar, binding = 2) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 3) readonly buffer Bounds { ProxyBounds bounds[]; };
layout(binding = 4) uniform samplerBuffer hull;
layout(scalar, binding = 5) readonly buffer ProxyActive { uint proxy_active[]; };
layout(binding = 6) uniform samplerBuffer directions;
layout(scalar, binding = 7) writeonly buffer Regions { Region regions[]; };
layout(scalar, binding = 8) writeonly buffer ActiveList { ActiveProxy active_list[]; };
layout(scalar, binding = 9) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 10) buffer Args { uint args[]; };

// Texels along the longer side at least, however coarse the scene asks for: with fewer, triangles slip between centres.
const float LEAST_TEXELS = 32.0;

shared vec4 partial[SIZE];
shared vec3 low[SIZE];
shared vec3 high[SIZE];

// Sums the partials in a fixed order; every lane gets the total.
vec4 total() {
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (gl_LocalInvocationID.x < width) partial[gl_LocalInvocationID.x] += partial[gl_LocalInvocationID.x + width];
    }
    barrier();
    vec4 sum = partial[0];
    barrier();
    return sum;
}

vec3 mean_direction(Pair pair, uint slot) {
    if (pair.is_plane != 0) return -pair.plane.xyz;
    if (pair.direction.w != 0.0) return pair.direction.xyz;
    uint lane = gl_LocalInvocationID.x;
    uint a_count = pair.proxy_count[0], b_count = pair.proxy_count[1];
    vec4 sum = vec4(0.0);
    vec4 strongest = vec4(0.0, 1.0, 0.0, -1.0);
    for (uint k = lane; k < pair.proxy_pair_count; k += SIZE) {
        vec4 direction = texelFetch(directions, int(pair.first_proxy_pair + k));
        if (direction.w <= 0.0) continue;
        sum += vec4(direction.w * direction.xyz, direction.w);
        if (direction.w > strongest.w) strongest = direction;
    }
    partial[lane] = sum;
    sum = total();
    // Directions that cancel: fall back to the strongest of them.
    // Divided first, so that no weight is large enough to overflow.
    vec3 mean = sum.xyz / sum.w;
    if (dot(mean, mean) > 0.01) return normalize(mean);
    partial[lane] = strongest;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width && partial[lane + width].w > partial[lane].w) partial[lane] = partial[lane + width];
    }
    barrier();
    strongest = partial[0];
    barrier();
    return strongest.xyz;
}

// Box of the active hulls of one side along the region's axes, inflated.
void side_box(Pair pair, uint side, uint first_slot, mat3 axes, out vec3 least, out vec3 greatest) {
    uint lane = gl_LocalInvocationID.x;
    least = vec3(3.0e38);
    greatest = vec3(-3.0e38);
    for (uint p = 0; p < pair.proxy_count[side]; p++) {
        if (proxy_active[first_slot + p] == 0) continue;
        uint id = pair.first_proxy[side] + p;
        float inflation = bounds[id].inflation;
        uint first = proxies[id].hull_first, count = proxies[id].hull_count;
        for (uint k = lane; k < count; k += SIZE) {
            vec3 x = texelFetch(hull, int(first + k)).xyz * axes;
            least = min(least, x - inflation);
            greatest = max(greatest, x + inflation);
        }
    }
    low[lane] = least;
    high[lane] = greatest;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) {
            low[lane] = min(low[lane], low[lane + width]);
            high[lane] = max(high[lane], high[lane + width]);
        }
    }
    barrier();
    least = low[0];
    greatest = high[0];
    barrier();
}

// Tangents that turn smoothly with the normal (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
mat3 axes_of(vec3 n) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint slot = 0;
    for (uint r = 0; r < PAIRS; r++) {
        Pair pair = pairs[r];
        vec3 n = mean_direction(pair, slot);
        mat3 axes = axes_of(n);
        vec3 a_low, a_high, b_low, b_high;
        side_box(pair, 0, slot, axes, a_low, a_high);
        slot += pair.proxy_count[0];
        if (pair.is_plane == 0) {
            side_box(pair, 1, slot, axes, b_low, b_high);
            slot += pair.proxy_count[1];
        } else {
            b_low = a_low;
            b_high = a_high;
        }
        if (lane == 0) {
            vec3 least = max(a_low, b_low), greatest = min(a_high, b_high);
            vec2 extent = greatest.xy - least.xy;
            bool touches = all(greaterThanEqual(extent, vec2(0.0)));
            float texel = max(max(extent.x, extent.y) / float(TILE - 2), 1.0e-9);
            if (touches && pair.is_plane == 0 && params.texel > 0.0) {
                if (params.texel < texel) counts.flags |= FLAG_REGION_OVERFLOW;
                texel = clamp(params.texel, texel, max(texel, max(extent.x, extent.y) / LEAST_TEXELS));
            }
            // A texel of border all round, so that a ray at the rim still has four neighbours.
            uvec2 size = touches ? min(uvec2(extent / texel) + 3, uvec2(TILE)) : uvec2(0);
            regions[r] = Region(n, axes[0], axes[1], least.xy - texel, texel, size.x, size.y,
                min(a_low.z, b_low.z), max(a_high.z, b_high.z));
        }
    }
    if (lane != 0) return;
    // The list, and its running totals.
    uint vertices = 0, triangles = 0, embeds = 0, listed = 0;
    slot = 0;
    for (uint r = 0; r < PAIRS; r++) {
        Pair pair = pairs[r];
        uint sides = pair.is_plane != 0 ? 1 : 2;
        for (uint side = 0; side < sides; side++) {
            for (uint p = 0; p < pair.proxy_count[side]; p++, slot++) {
                if (proxy_active[slot] == 0) continue;
                uint id = pair.first_proxy[side] + p;
                active_list[listed++] = ActiveProxy(id, 2 * r + side, vertices, triangles, embeds);
                vertices += proxies[id].vertex_count;
                if (pair.is_plane == 0) triangles += proxies[id].triangle_count;
                embeds += proxies[id].embed_count;
            }
        }
    }
    counts.active_proxies = listed;
    counts.vertices = vertices;
    counts.triangles = triangles;
    counts.embeds = embeds;
    args[3 * ARGS_EMBED] = groups_of(embeds);
    args[3 * ARGS_RASTER] = groups_of(triangles);
    args[3 * ARGS_CANDIDATES] = groups_of(vertices);
    args[3 * ARGS_COMPACT] = vertices > 0 ? 1 : 0;
    args[3 * ARGS_DRAW] = 3 * triangles;
    args[3 * ARGS_DRAW + 1] = 1;
    args[3 * ARGS_DRAW + 2] = 0;
    args[3 * ARGS_DRAW + 3] = 0;
}
