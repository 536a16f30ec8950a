//! The daemon that picks the generation parameters under the user's limits.
