//! How the candidates of a triangle are walked.

/// A way through the candidates of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Navigation {
    /// First approach of the paper: test every voxel of the span over each column.
    PlaneSpan,
    /// Second approach: test from both ends of the span inward, mark what lies between the first
    /// hits.
    TwoSided,
    /// The quicker way for each triangle: every voxel of its box where that holds few, else
    /// [`Self::TwoSided`].
    Auto,
    /// No navigation: test every voxel of the triangle's box. What the paper calls naïve; for
    /// measuring the other two against it.
    WholeBox,
}

impl Navigation {
    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::PlaneSpan => "plane-span",
            Self::TwoSided => "two-sided",
            Self::Auto => "auto",
            Self::WholeBox => "whole-box",
        }
    }

    /// What is taken where nothing is asked for.
    ///
    /// Of a triangle smaller than a voxel the columns take longer to prepare than its few voxels to
    /// test. Between the two navigations the paper gives crossovers in voxels for three models.
    /// Ours has none: columns run along the dominant axis of the normal, so a span is rarely longer
    /// than three voxels, and a column is solved as a whole before a test is asked for (see
    /// `columns`). Measured in CPU time, plane-span against two-sided: 58 and 56 ms (triangles of 2
    /// voxels, 0.22 M surface voxels), 246 and 250 ms (7 voxels, 3.6 M), 0.98 and 0.94 s (16
    /// voxels, 20 M), 1.12 and 1.05 s (3 M triangles below a voxel); 6 % apart at most, without a
    /// direction.
    pub const AUTO: Self = Self::Auto;
}
