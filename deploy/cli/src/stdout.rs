//! Lines on standard output that survive a reader who leaves.

/// Prints a line as `println!` does. If the reader has closed the pipe, the line is lost and the program continues.
#[macro_export]
macro_rules! say {
    ($($arg:tt)*) => {
        $crate::stdout::line(format_args!($($arg)*))
    };
}

/// Writes `text` and a newline to standard output; see [`say!`].
///
/// # Panics
/// As `println!` does, on any error but a closed pipe.
pub fn line(text: std::fmt::Arguments<'_>) {
    use std::io::{ErrorKind, Write};
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => panic!("standard output: {error}"),
        _ => {}
    }
}
