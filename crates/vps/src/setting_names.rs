//! What texts call the settings that they ask a user to look at or to change.

/// A name for each setting that a text of this crate speaks of: a program gives those of its own
/// interface, such as keys or flags, and no text has any others.
#[derive(Clone, Copy, Debug)]
pub struct SettingNames {
    /// The unit of the numbers of a mesh file.
    pub unit: &'static str,
    /// [`InsideTest::Flood`](crate::InsideTest::Flood).
    pub flood: &'static str,
    /// [`InsideTest::Thin`](crate::InsideTest::Thin).
    pub thin_skin: &'static str,
    /// How much memory may be taken, after an article.
    pub memory_limit: &'static str,
    /// How many mass points clay has.
    pub raster: &'static str,
    /// The part of clay that deforms.
    pub region: &'static str,
}

impl SettingNames {
    /// Plain words, for a caller in any language.
    pub const PLAIN: Self = Self {
        unit: "the unit",
        flood: "the flood fill",
        thin_skin: "a thin skin",
        memory_limit: "limit of memory",
        raster: "the raster",
        region: "the region",
    };
}
