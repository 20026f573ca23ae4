// Variants of a solver kernel, by the specialization constant ROLE. They run side by side, each without the code of the
// others, for which masked lanes would pay.

const uint FREE_NODES = 0;      // works on blocks of free nodes
const uint ATTACHED_NODES = 1;   // works on blocks of nodes attached to dynamic cores
const uint TOOL_ROWS = 2;       // works on the six rows of the tool, which has no nodes

// Variants of solve/gather by when it runs, the specialization constant MODE.
const uint GATHER_WARM_START = 0;     // before the iterations, for the warm start
const uint GATHER_LOOP = 1;     // in an iteration
const uint GATHER_END = 2;      // after the iterations, for the recomputed residual
