// Values of node_info.w: what determines a node's motion. A dynamic core is a rigid core inside a soft body, a frame a
// rigid coordinate frame.

const uint NODE_FREE = 0;       // a free node, an unknown of the solver
const uint NODE_KINEMATIC = 1;       // a node attached to a frame whose motion is prescribed
const uint NODE_ATTACHED = 2;    // a node attached to a dynamic core, whose motion the solver finds
