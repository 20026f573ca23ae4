#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// contact/compact.glsl by itself, for its test. One workgroup.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const uint CAPACITY = 1;
layout(constant_id = 3) const uint TETRAHEDRA = 0;

layout(scalar, binding = 0) readonly buffer CandidateHits { vec4 candidate_hits[]; };
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) writeonly buffer ContactSource { uint contact_source[]; };
layout(scalar, binding = 3) writeonly buffer Args { uint args[]; };

#include "contact/compact.glsl"

void main() { compact(); }
