//! The binary `lamina`: all nodes and an example simulation in one process, and the command-line tools.

#![deny(clippy::print_stdout)]

#[macro_use]
mod say;

mod accuracy;
mod bench;
mod bench_live;
mod cli;
mod dims;
mod doctor;
mod effects_cost;
mod nodes;
mod outputs;
mod pacer;
mod parts;
mod picture_file;
mod process;
mod rd;
mod report;
mod scene_file;
mod source;
mod study;
mod watch;

use clap::Parser;
use cli::{Cli, Command};

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    lamina_rpc::daemon::log_to_stderr("warn");
    let outcome = match cli.command.unwrap_or_default() {
        Command::Live(live) => watch::live(&live),
        Command::Replay(replay) => watch::replay(&replay),
        Command::Raycast(arguments) => parts::raycast(&arguments),
        Command::Generate(arguments) => parts::generate(&arguments),
        Command::Render(arguments) => parts::render(&arguments),
        Command::Compare(arguments) => parts::compare(&arguments),
        Command::Bench(arguments) => bench::bench(&arguments),
        Command::Tune(arguments) => study::contract(&arguments),
        Command::Study(arguments) => study::study(&arguments),
        Command::Accuracy(arguments) => accuracy::accuracy(&arguments),
        Command::Rd(arguments) => rd::rd(&arguments),
        Command::Doctor => doctor::doctor(),
    };
    lamina_rpc::daemon::exit_code(outcome)
}
