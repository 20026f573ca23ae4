// node_info.w: who decides a node's motion.

const uint FREE = 0;        // the solver
const uint HELD = 1;        // a frame whose motion is known
const uint CARRIED = 2;     // a dynamic core, whose motion the solver finds
