//! Lengths and places as a reader sees them.

use std::fmt;

use glam::DVec3;

/// A length in metres, shown in the unit in which people say it: µm, mm or m, with four significant
/// digits at most.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Metres(pub f64);

/// A place in metres, shown in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place(pub DVec3);

impl fmt::Display for Metres {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (number, unit) = match self.0.abs() {
            0.0 => (0.0, "mm"),
            metres if metres < 1e-4 => (self.0 * 1e6, "µm"),
            metres if metres < 1.0 => (self.0 * 1e3, "mm"),
            _ => (self.0, "m"),
        };
        write!(f, "{} {unit}", four_digits(number))
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.to_array().map(|metres| four_digits(metres * 1e3));
        write!(f, "({x}, {y}, {z}) mm")
    }
}

fn four_digits(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_in_the_unit_in_which_people_say_them() {
        for (metres, text) in [
            (0.0, "0 mm"),
            (3.6e-5, "36 µm"),
            (1.2e-3, "1.2 mm"),
            (0.036, "36 mm"),
            (0.999_96, "1000 mm"),
            (50.0, "50 m"),
            (-0.25, "-250 mm"),
            (f64::INFINITY, "inf m"),
            (f64::NAN, "NaN m"),
        ] {
            assert_eq!(Metres(metres).to_string(), text);
        }
        assert_eq!(Place(DVec3::new(1e-3, 0.0, -0.012_345_6)).to_string(), "(1, 0, -12.35) mm");
    }
}
