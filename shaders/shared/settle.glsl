// What a workgroup wrote to coherent buffers is there for all of it.

void settle() {
    memoryBarrierBuffer();
    barrier();
}
