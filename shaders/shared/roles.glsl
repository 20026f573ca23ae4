// What a variant of a pass works on. Variants run side by side; none has the code of the others, which lanes that are masked
// would pay for.

const uint FREE_NODES = 0;      // blocks of free nodes
const uint CARRIED_NODES = 1;   // blocks of nodes that dynamic cores carry
const uint TOOL_ROWS = 2;       // the tool, without nodes

// When solve/gather runs.
const uint GATHER_WARM = 0;     // for the warm start
const uint GATHER_LOOP = 1;     // in an iteration
const uint GATHER_END = 2;      // for the residual at the end
