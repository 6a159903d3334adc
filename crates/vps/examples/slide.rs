//! A ball slides over an edge: 2000 poses in one batch, force and clearance as a plot.
//!
//! `cargo run --release -p vps --example slide [PLOT.svg]`
#![expect(clippy::print_stdout, reason = "what an example is for")]

use std::fmt::Write as _;

use vps::{
    ContactQuery, ContactWrench, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap,
};

const POSES: u16 = 2000;

pub(crate) fn main() -> Result<(), Error> {
    let block = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-5)?;
    let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    let options = Options::new(0.5e-3);
    let query = ContactQuery::new(
        &Voxmap::bake(&block, &options)?,
        &PointShell::bake(&ball, &options)?,
        200.0,
    )?;

    // From over the block, 0.3 mm deep, beyond its edge at x = 20 mm.
    let x_m: Vec<f64> = (0..POSES).map(|n| 30e-3 * f64::from(n) / f64::from(POSES)).collect();
    let poses: Vec<Pose> =
        x_m.iter().map(|x_m| Pose::from_translation(DVec3::new(*x_m, 0.0, 29.7e-3))).collect();
    let felt = query.wrenches(&poses)?;

    let path = std::env::args()
        .nth(1)
        .filter(|name| name.ends_with(".svg"))
        .map_or_else(|| std::env::temp_dir().join("slide.svg"), Into::into);
    std::fs::write(&path, plot(&x_m, &felt)).map_err(|error| Error::File {
        path: path.clone(),
        what: error.to_string(),
        source: Some(error),
    })?;
    println!(
        "{}: {} poses, {:.2} N over the block",
        path.display(),
        felt.len(),
        felt.first().map_or(0.0, |felt| felt.wrench.force.z)
    );
    Ok(())
}

/// Force upwards and sideways, N, and clearance, each a line over x from 0 to 30 mm.
fn plot(x_m: &[f64], felt: &[ContactWrench]) -> String {
    let most_n = felt.iter().map(|felt| felt.wrench.force.length()).fold(1e-9, f64::max);
    let mut svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 620 260\" \
            font-family=\"sans-serif\" font-size=\"12\">\n"
        .to_owned();
    let mut line = |name: &str, color: &str, y: f64, value: &dyn Fn(&ContactWrench) -> f64| {
        let points: Vec<String> = x_m
            .iter()
            .zip(felt)
            .map(|(x_m, felt)| {
                format!("{:.1},{:.1}", 10.0 + x_m * 20e3, 210.0 - 180.0 * value(felt))
            })
            .collect();
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" stroke=\"{color}\" points=\"{}\"/>",
            points.join(" ")
        );
        let _ = writeln!(svg, "<text x=\"450\" y=\"{y}\" fill=\"{color}\">{name}</text>");
    };
    line(&format!("force up / {most_n:.1} N"), "#1f77b4", 20.0, &|felt| {
        felt.wrench.force.z / most_n
    });
    line(&format!("force aside / {most_n:.1} N"), "#d62728", 40.0, &|felt| {
        felt.wrench.force.x / most_n
    });
    line("clearance / 5 mm", "#2ca02c", 60.0, &|felt| felt.clearance_m / 5e-3);
    svg + "<line x1=\"10\" y1=\"210\" x2=\"610\" y2=\"210\" stroke=\"black\"/><text x=\"10\" \
        y=\"240\">x from 0 to 30 mm; the edge is at 20 mm</text>\n</svg>\n"
}
