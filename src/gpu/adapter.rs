//! An adapter: a graphics card or a program that stands in for one, as its driver describes it.

use std::fmt;

/// What a driver says of an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// The card's name.
    pub name: String,
    /// How it is spoken to: `vulkan`, `metal` or `dx12`.
    pub api: String,
    /// The driver's name and version, empty where it says nothing.
    pub driver: String,
    /// Whether it is a program on the CPU, which our own CPU code outruns.
    pub is_software: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}", self.name, self.api)?;
        if !self.driver.is_empty() {
            write!(f, ", {}", self.driver)?;
        }
        f.write_str(")")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_driver_is_left_out() {
        let mut adapter = Adapter {
            name: "Card".to_owned(),
            api: "vulkan".to_owned(),
            driver: "maker 1.2".to_owned(),
            is_software: false,
        };
        assert_eq!(adapter.to_string(), "Card (vulkan, maker 1.2)");
        adapter.driver.clear();
        assert_eq!(adapter.to_string(), "Card (vulkan)");
    }
}
