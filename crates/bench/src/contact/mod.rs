//! Figures of contact: how right a force is, how it feels through the couplings, how long a query
//! takes.
//!
//! | file | owns |
//! |---|---|
//! | [`scenarios`] | Q1 to Q3: contacts with a known force |
//! | [`fields`] | their errors, per field |
//! | `couplings` | Q1 through the couplings, insertion of a peg, smoothness of the shipped scenes |
//! | [`sliding`] | smoothness of the force law over the shipped scenes |
//! | `curved`, `law` | smoothness, size and direction of the force over curved parts, beside the exact law |
//! | `lattice` | what other interpolations would make of it |
//! | `attitudes` | faces, corners and convergence of tools at random in their grids |
//! | `speed`, `nut` | time against points, contact share, triangles; the nut on its bolt beside other programs |
//! | `many` | time against the number of objects |
//! | `near_misses` | time of a query just before contact |
//! | `insertions` | which voxel size an insertion needs |
//! | `stress` | a million points in a violent hand, every tick judged |
//! | [`wrench`] | contact wrenches of several programs, beside closed forms |
//! | [`clay`] | steps of the force between updates of clay; what a tick on clay costs |
//! | `accuracy` | fields of real meshes beside exact distances |
//! | `scenes` | scene files with some keys changed, on the virtual clock |
//! | `fixture`, [`ripple`], `csv` | parts; what is rough; files |

mod accuracy;
mod attitudes;
pub mod clay;
mod couplings;
mod csv;
mod curved;
pub mod fields;
mod fixture;
mod insertions;
mod lattice;
mod law;
mod many;
mod near_misses;
mod nut;
pub mod ripple;
pub mod scenarios;
mod scenes;
pub mod sliding;
mod speed;
mod stress;
pub mod wrench;

use std::path::PathBuf;

pub use accuracy::{FieldErrors, field_errors};
pub use couplings::ForceSeries;
pub use csv::Csv;

use self::sliding::{DEPTHS_VOXELS, SlideForces};
use super::export::TemporaryFolder;
use super::{BenchError, Row};
use hapticd::scene::cache::{Cache, CachePolicy};

/// What to measure, and with what.
#[derive(Clone, Debug)]
pub struct Options {
    /// Runs of a timing; figures are medians.
    pub n_runs: usize,
    /// Small cases only.
    pub quick: bool,
    /// Folder of the shipped scenes; rows over them are skipped where it has none.
    pub scenes: PathBuf,
    /// Where to write raw results; `None`: nowhere.
    pub csv: Option<PathBuf>,
    /// Folder of real meshes; without it those rows are skipped.
    pub models: Option<PathBuf>,
    /// Folder of peer programs; without it those figures are skipped.
    pub peers: Option<PathBuf>,
}

/// What [`quality`] found.
#[derive(Debug)]
pub struct Quality {
    /// Every figure.
    pub rows: Vec<Row>,
    /// The table that says what to choose, as markdown.
    pub choice: String,
    /// Slides over the shipped scenes at constant depth, for plots.
    pub slides: Vec<SlideForces>,
    /// What a hand feels of them, for plots.
    pub felt: Vec<ForceSeries>,
}

/// Measures the quality of forces. `tell` is called with each step.
///
/// Cost: two or three minutes; quick, some seconds.
///
/// # Errors
/// A part that cannot be baked, or a file that cannot be written. A scene that is not there or that
/// this version lacks is a row that says so.
pub fn quality(options: &Options, mut tell: impl FnMut(&str)) -> Result<Quality, BenchError> {
    let mut csv = Csv::new(options.csv.clone())?;
    tell("Q1 to Q3: fields");
    let measured = fields::measure(
        &scenarios::all(if options.quick { 240 } else { scenarios::LONGEST_TICKS })?,
        &mut csv,
    )?;
    let mut rows = fields::rows(&measured);
    rows.extend(accuracy::rows(options, &mut tell));
    let folder = TemporaryFolder::create()
        .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
    let mut cache = Cache::at(folder.path().join("cache"), CachePolicy::Copy);
    let slides = if options.quick {
        Vec::new()
    } else {
        sliding::slides_with(&options.scenes, &DEPTHS_VOXELS, &mut cache, &mut tell)?
    };
    rows.extend(sliding::rows(&slides, &mut csv)?);
    rows.extend(curved::rows(options, &mut csv, &mut tell)?);
    rows.extend(attitudes::rows(options, &mut tell)?);
    let felt =
        couplings::measure(options, &measured, folder.path(), &mut csv, &mut cache, &mut tell)?;
    rows.extend(felt.rows);
    Ok(Quality { rows, choice: felt.choice, slides, felt: felt.series })
}

/// Measures the time of contact queries. `tell` is called with each step. Cost: minutes, most of
/// them peers; quick, some seconds.
///
/// # Errors
/// A part that cannot be baked. A mesh or a peer that is not there is a row that says so.
pub fn speed(options: &Options, mut tell: impl FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let mut rows = speed::rows(options, &mut tell)?;
    rows.extend(nut::rows(options, &mut tell)?);
    rows.extend(many::rows(options, &mut tell)?);
    rows.extend(near_misses::rows(options, &mut tell)?);
    Ok(rows)
}

/// Inserts parts at several voxel sizes and clearances: rows, and a table as markdown. `tell` is
/// called with each step. Cost: some minutes; quick, some seconds.
///
/// # Errors
/// A scene that cannot be baked or played.
pub fn insertions(
    options: &Options,
    mut tell: impl FnMut(&str),
) -> Result<(Vec<Row>, String), BenchError> {
    insertions::measure(options, &mut tell)
}

/// Plays a violent hand with a million points, and judges every tick. `tell` is called with each
/// step. Cost: a quarter of an hour; quick, half a minute.
///
/// # Errors
/// A scene that cannot be baked or played. A folder without scenes is a row that says so.
pub fn stress(options: &Options, mut tell: impl FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    stress::rows(options, &mut tell)
}
