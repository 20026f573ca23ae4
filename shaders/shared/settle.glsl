// Waits for a workgroup's invocations, and makes what they wrote to coherent buffers visible to all of them.

void settle() {
    memoryBarrierBuffer();
    barrier();
}
