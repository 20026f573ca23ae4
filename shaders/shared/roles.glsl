// Variants of a solver kernel, selected by the specialization constant ROLE. They run concurrently. Each variant leaves
// out the code of the others, which would cost time even where all its lanes are masked. A block is a set of nodes that
// one workgroup works on. A dynamic core is a rigid body inside a soft one; the solver finds the core's motion. The
// tool is the rigid body that the haptic device leads.

const uint FREE_NODES = 0;      // works on blocks of free nodes
const uint ATTACHED_NODES = 1;   // works on blocks of nodes attached to dynamic cores
const uint TOOL_ROWS = 2;       // works on the six equations (rows) of the tool, which has no nodes

// Variants of solve/gather, selected by the specialization constant MODE. Each runs at its own time, relative to the
// conjugate gradient iterations.
const uint GATHER_WARM_START = 0;     // before the iterations, for the warm start (from the last solution and the trend)
const uint GATHER_LOOP = 1;     // in an iteration
const uint GATHER_END = 2;      // after the iterations, for the recomputed residual
