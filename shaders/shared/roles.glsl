// What a variant of a pass works on. Variants run side by side; none has the code of the others, which lanes that are masked
// would pay for.

const uint FREE_NODES = 0;      // blocks of free nodes
const uint CARRIED_NODES = 1;   // blocks of nodes that dynamic cores carry
const uint TOOL_ROWS = 2;       // the tool, without nodes
