//! Lines on standard output.

/// As `println!`, but whoever reads may leave: what is said then is lost, and the work goes on. `println!` would panic.
macro_rules! say {
    ($($arg:tt)*) => {{
        use std::io::Write;
        let _ = writeln!(std::io::stdout(), $($arg)*);
    }};
}
