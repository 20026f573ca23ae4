// Waits for all invocations of the workgroup, and makes what each wrote to coherent buffers visible to the others.

void settle() {
    memoryBarrierBuffer();
    barrier();
}
