// Counts of loops in which the lanes of a workgroup share elements. The including shader declares SIZE, the workgroup's
// size.

// How many of `count` elements this lane handles, where each lane handles every SIZE-th element.
uint turns_of(uint count) { return (count + SIZE - 1 - gl_LocalInvocationID.x) / SIZE; }
