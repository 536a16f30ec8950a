//! Lamina in one process: the commands of the binary `lamina` as a library.
//!
//! [`watch`] couples a simulation ([`source`]) to a generator-node, a viz-node and a tuner that run in this process
//! ([`nodes`]); [`serve`] waits for simulations of others there. [`offline`] works on files without nodes, and [`in_process`] measures generation parameters without them,
//! which [`tune`] and the laboratory `lamina-lab` use.

#![deny(clippy::print_stdout)]

#[macro_use]
pub mod stdout;

pub mod cli;
pub mod dims;
pub mod doctor;
pub mod export;
pub mod follow;
pub mod in_process;
pub mod keys;
mod movie;
pub mod nodes;
pub mod offline;
mod out_of_core;
pub mod pacer;
mod picture_file;
pub mod process;
mod run_folder;
pub mod scene_file;
pub mod serve;
pub mod source;
mod steering;
mod terminal;
pub mod tune;
pub mod watch;
