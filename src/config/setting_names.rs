//! What texts of the libraries call the settings of this program.

use vps::setting_names::SettingNames;

/// Keys of a scene, and flags where there is no key.
pub const KEYS: SettingNames = SettingNames {
    unit: "`units`",
    flood: "`sides = \"flood\"`",
    thin_skin: "`sides = \"thin\"`",
    memory_limit: "--max-memory",
    raster: "`sculpt.raster`",
    region: "the region (the thin box on the page; `region_mm` in the scene, or the stroke `region`)",
};

/// What to do about a file of a scene that is not there.
pub const MISSING: &str = "paths in a scene are relative to the scene file";

/// Flags of commands that take a mesh.
pub const FLAGS: SettingNames =
    SettingNames { unit: "--units", flood: "--sides flood", thin_skin: "--sides thin", ..KEYS };
