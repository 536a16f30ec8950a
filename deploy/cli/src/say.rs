//! Lines on standard output.

/// As `println!`, but whoever reads may leave: what is said then is lost, and the work goes on.
macro_rules! say {
    ($($arg:tt)*) => {
        $crate::say::line(format_args!($($arg)*))
    };
}

/// # Panics
/// As `println!` does, if the line cannot be written though somebody would read it.
pub fn line(text: std::fmt::Arguments<'_>) {
    use std::io::{ErrorKind, Write};
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => panic!("standard output: {error}"),
        _ => {}
    }
}
