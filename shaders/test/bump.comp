#version 460
// Test kernel for the recorder of command buffers (src/gpu/recorder.rs), not part of the step: cells[i] becomes
// 3 cells[i] + amount for i < count. One invocation runs for each cell.
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x_id = 0) in;
layout(scalar) buffer Cells { uint cells[]; };
layout(push_constant, scalar) uniform Push { uint amount; uint count; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    cells[i] = cells[i] * 3 + amount;
}
