#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: a surface in the light of a sun and a sky, or coloured by its values. One invocation a pixel.

layout(scalar, binding = 0) uniform Views { View view; };
layout(binding = 4) uniform samplerBuffer shadow;       // depths that the sun sees
layout(binding = 5) uniform samplerBuffer colours;      // of values, 256, linear
layout(scalar, binding = 6) uniform Materials { Material materials[32]; };
layout(push_constant) uniform Push { uint material_index; };

layout(location = 0) in vec3 x;
layout(location = 1) in vec3 normal;
layout(location = 2) in float value;
layout(location = 0) out vec4 colour;

#include "shared/shade.glsl"

void main() {
    Material material = materials[material_index];
    vec3 eye = normalize(view.eye - x);
    vec3 n = (material.flags & FLAT) != 0 ? cross(dFdx(x), dFdy(x)) : normal;
    n = normalize(n);
    if (dot(n, eye) < 0.0) n = -n;
    vec4 own = material.colour;
    float evenness = 0.0;
    if ((material.flags & VALUED) != 0) {
        float share = clamp((value - material.low) / (material.high - material.low), 0.0, 1.0);
        vec3 mapped = texelFetch(colours, int(share * 255.0 + 0.5)).rgb;
        // Where there is nothing to show, the surface itself is seen.
        evenness = (material.flags & EVEN) != 0 ? 1.0 : smoothstep(0.0, 0.02, share);
        own.rgb = mix(own.rgb, mapped, evenness);
    }
    if ((material.flags & UNLIT) != 0) {
        colour = vec4(shown(own.rgb) * own.a, own.a);
        return;
    }
    float facing = max(dot(n, eye), 0.0);
    float towards = dot(n, view.sun);
    float sun = towards > 0.0 ? towards * lit(x, n) : 0.0;
    float sky = 0.5 + 0.5 * n.y;
    // Values are read by their colour: light alters them less.
    vec3 light = mix(vec3(0.16, 0.16, 0.18) + sky * vec3(0.26, 0.28, 0.31) + sun * vec3(0.86, 0.82, 0.74),
                     vec3(0.62 + 0.18 * sky + 0.3 * sun), evenness);
    vec3 bright = own.rgb * light;
    vec3 halfway = normalize(eye + view.sun);
    float glint = sun > 0.0 ? pow(max(dot(n, halfway), 0.0), 40.0) * sun : 0.0;
    bright += vec3(0.10 * glint * (1.0 - evenness));
    float alpha = own.a;
    if ((material.flags & GLASS) != 0) {
        float rim = 1.0 - facing;
        alpha = clamp(own.a + (0.95 - own.a) * rim * rim * rim, 0.0, 1.0);
        bright += vec3(0.5 * glint);
    }
    colour = vec4(shown(bright) * alpha, alpha);
}
