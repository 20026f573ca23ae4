#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/contact_law.glsl"

// Draw stage (for display, not part of a step): depth (m) and pressure (Pa) of the last step's contacts at skin
// vertices (vertices of the bodies' surface meshes). A contact counts at the vertex that collided and at the corners of
// the triangle that this vertex met, so that both skins show the contact; where a vertex has several contacts, the
// greatest depth and the greatest pressure count. The pressure is what the solver applied at the end of the step
// (end_pressure in shared/contact_law.glsl), or zero if this pressure is negative. After a saved state was loaded this
// pressure is not known; then the pressure at the start of the step stands for it. A contact that was released, because
// it would have pulled, counts for neither depth nor pressure. The arrays are cleared before. No depth or pressure is
// negative, so the bits of these floats, read as integers, sort like the floats. One invocation runs for each contact;
// it writes by atomics whose order does not matter. The test compares with Simulation::touch.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint CAPACITY = 0;

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_ONLY(uvec4, contacts);
READ_ONLY(vec4, contact_forces);
READ_ONLY(uvec4, triangles);
layout(scalar) readonly buffer Solved { uint is_solved; };         // whether contact_forces belongs to these contacts
layout(scalar) buffer Depths { uint depths[]; };                   // bits of a float for each skin vertex
layout(scalar) buffer Pressures { uint pressures[]; };             // bits of a float for each skin vertex

#include "shared/contact.glsl"

const float LARGEST = 3.0e38;

// Bits of a positive number; zero for NaN and infinity.
uint bits_of(float x) { return x > 0.0 && x < LARGEST ? floatBitsToUint(x) : 0; }

void main() {
    uint c = gl_GlobalInvocationID.x;
    if (c >= min(counts.contacts, CAPACITY)) return;
    Contact contact = contact_at(c);
    if (is_released(contact)) return;
    float pressure = is_solved != 0 ? end_pressure(contact, fetch(contact_forces, c), params.dt)
        : start_pressure(contact.depth, contact.rate, contact.stiffness, contact.damping);
    uint depth_bits = bits_of(contact.depth), pressure_bits = bits_of(pressure);
    uvec3 met = contact.triangle == NONE ? uvec3(contact.vertex) : fetch(triangles, contact.triangle).xyz;
    uint touched[4] = uint[](contact.vertex, met.x, met.y, met.z);
    for (uint k = 0; k < 4; k++) {
        atomicMax(depths[touched[k]], depth_bits);
        atomicMax(pressures[touched[k]], pressure_bits);
    }
}
