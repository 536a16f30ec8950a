//! The binary `lamina-lab`: measures what the product's parameters, codings and kernels are worth, on the user's own data.

#![deny(clippy::print_stdout)]

mod accuracy;
mod bench;
mod bench_live;
mod cli;
mod consecutive;
mod rd;
mod study;
mod table;

use clap::Parser;
use cli::{LabCli, LabCommand};

fn main() -> std::process::ExitCode {
    let cli = LabCli::parse();
    lamina_rpc::daemon::log_to_stderr("warn");
    let outcome = match cli.command {
        LabCommand::Study(arguments) => study::study(&arguments),
        LabCommand::Rd(arguments) => rd::rd(&arguments),
        LabCommand::Consecutive(arguments) => consecutive::consecutive(&arguments),
        LabCommand::Accuracy(arguments) => accuracy::accuracy(&arguments),
        LabCommand::Bench(arguments) => bench::bench(&arguments),
        LabCommand::BenchLive(arguments) => bench_live::bench_live(&arguments),
    };
    lamina_rpc::daemon::exit_code(outcome)
}
