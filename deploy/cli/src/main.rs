//! The binary `lamina`: reads the command line and runs one command of the library.

#![deny(clippy::print_stdout)]

use clap::Parser;
use lamina::cli::{Cli, Command};
use lamina::{doctor, export, follow, keys, offline, serve, tune, watch};

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    lamina_rpc::daemon::log_to_stderr("warn");
    let outcome = match cli.command.unwrap_or_default() {
        Command::Live(arguments) => watch::live(&arguments),
        Command::Replay(arguments) => watch::replay(&arguments),
        Command::Serve(arguments) => serve::serve(&arguments),
        Command::Watch(arguments) => follow::follow(&arguments),
        Command::Raycast(arguments) => offline::raycast(&arguments),
        Command::Generate(arguments) => offline::generate(&arguments),
        Command::Render(arguments) => offline::render(&arguments),
        Command::Export(arguments) => export::export(&arguments),
        Command::Compare(arguments) => offline::compare(&arguments),
        Command::Tune(arguments) => tune::tune(&arguments),
        Command::Keys(arguments) => keys::keys(&arguments),
        Command::Doctor(arguments) => doctor::doctor(&arguments),
    };
    lamina_rpc::daemon::exit_code(outcome)
}
