// Makes what a workgroup wrote to coherent buffers visible to all its invocations.

void settle() {
    memoryBarrierBuffer();
    barrier();
}
