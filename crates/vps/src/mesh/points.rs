//! Points without faces, as their readers give them.

use glam::DVec3;

/// Points as a file has them, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// `[n]`, m, in the axes of the file.
    pub positions: Vec<DVec3>,
    /// `[n]`, of any length; `None`: the file has none.
    pub normals: Option<Vec<DVec3>>,
    /// `[n]`, sRGB; `None`: the file has none.
    pub colors: Option<Vec<[u8; 3]>>,
}
