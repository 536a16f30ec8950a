//! Names of plain enums in files, on the page and on the command line.

/// Gives a plain enum `ALL`, `name`, `Display` and `FromStr`: `named!(Type, "thing", "neither a nor b", A "a", B "b")`.
#[macro_export]
macro_rules! named {
    ($type:ident, $thing:literal, $none:literal, $($value:ident $name:literal),+) => {
        impl $type {
            /// All of them.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$value),+];

            /// Its name in files and on the page.
            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $name),+ }
            }
        }

        impl std::str::FromStr for $type {
            type Err = $crate::Invalid;
            fn from_str(s: &str) -> Result<Self, $crate::Invalid> {
                let unknown = || $crate::Invalid::new($thing, format!("\"{s}\" is {}", $none));
                Self::ALL.into_iter().find(|value| value.name() == s).ok_or_else(unknown)
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}
