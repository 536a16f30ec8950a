//! What a simulation links to hand its time steps to a generator-node.
