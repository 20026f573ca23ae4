// What determines the motion of a node of a soft body's mesh: values of the component w of the array `node_info`. A
// core is a rigid body inside a soft one; it is dynamic if the solver finds its motion. A frame is the rigid coordinate
// frame of a body or core.

const uint NODE_FREE = 0;       // a free node, an unknown of the solver
const uint NODE_KINEMATIC = 1;       // a node attached to a frame whose motion is prescribed
const uint NODE_ATTACHED = 2;    // a node attached to a dynamic core, whose motion the solver finds
