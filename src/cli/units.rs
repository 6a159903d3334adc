//! Units of length on the command line.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::config::draft::Unit;

/// A unit of length, by its name in scenes.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnitArg(pub(super) Unit);

impl ValueEnum for UnitArg {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self(Unit::M), Self(Unit::Mm), Self(Unit::Cm), Self(Unit::In)]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()))
    }
}
