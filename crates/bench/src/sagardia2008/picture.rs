//! The models as polygons, voxmap and pointshell.
//!
//! # Source
//! Sagardia2008, figure 4. Voxels are as large there as here or smaller: as many as a picture of
//! this size can show.

use std::path::Path;

use glam::DVec3;
use picture::parts::write_structures;
use picture::{BakedObject, Marks};

use super::super::BenchError;
use super::super::stand_ins::StandIn;
use super::{Figures, SEED};
use vps::mesh::validate::inspect;
use vps::pointshell;
use vps::voxmap::{Options, Volume};

/// Writes `sagardia-2008-MODEL.png` for each model that was measured.
///
/// # Errors
/// A picture that cannot be written, or a model that cannot be baked.
pub fn draw_models(folder: &Path, figures: &Figures) -> Result<(), BenchError> {
    for (stand_in, _) in figures.models() {
        let name = stand_in.name();
        let mesh = stand_in.mesh(SEED);
        let map = Volume::build(
            &mesh,
            &inspect(&mesh),
            &Options::new(shown_size_mm(stand_in) * 1e-3),
            |_| (),
        )
        .map_err(|error| BenchError::Prepare { what: name.to_owned(), why: error.to_string() })?;
        let (shell, _) = pointshell::build(&mesh, &map, DVec3::ZERO);
        let subject = BakedObject {
            name,
            surface: &map.surface,
            layers: &map.layers,
            shell: &shell,
            center_of_mass_tool: DVec3::ZERO,
            thin: map.thin,
            marks: &Marks::default(),
        };
        let path = folder.join(format!("sagardia-2008-{name}.png"));
        write_structures(&path, &mesh, &subject)
            .map_err(|source| BenchError::Write { path, source })?;
    }
    Ok(())
}

fn shown_size_mm(stand_in: StandIn) -> f64 {
    match stand_in {
        StandIn::Bracket => 8.0,
        StandIn::Brake => 4.0,
        StandIn::Car => 20.0,
    }
}
