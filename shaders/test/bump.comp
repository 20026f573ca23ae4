#version 460
// Recorder self-test: cells[i] = 3 cells[i] + amount, for every cell; stands in no step.
// One invocation per cell; each writes its own.
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x_id = 0) in;
layout(scalar) buffer Cells { uint cells[]; };
layout(push_constant, scalar) uniform Push { uint amount; uint count; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    cells[i] = cells[i] * 3 + amount;
}
