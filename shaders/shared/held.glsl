// node_info.w: who decides a node's motion.

const uint NODE_FREE = 0;       // the solver
const uint NODE_HELD = 1;       // a frame whose motion is known
const uint NODE_CARRIED = 2;    // a dynamic core, whose motion the solver finds
