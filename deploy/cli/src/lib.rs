//! Watch a running simulation at a price you name.
