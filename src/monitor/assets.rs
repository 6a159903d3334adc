//! The page, embedded in the program: one line for each file of `web/`.

use std::sync::OnceLock;

use axum::body::Bytes;

use super::compressed::Compressed;

/// Name below `/web/`, content type, bytes.
pub(super) const FILES: &[(&str, &str, &[u8])] = &[
    ("index.html", HTML, include_bytes!("web/index.html")),
    ("style.css", CSS, include_bytes!("web/style.css")),
    ("icon.svg", SVG, include_bytes!("web/icon.svg")),
    ("camera.js", SCRIPT, include_bytes!("web/camera.js")),
    ("clay-hand.js", SCRIPT, include_bytes!("web/clay-hand.js")),
    ("clay-numbers.js", SCRIPT, include_bytes!("web/clay-numbers.js")),
    ("clay.css", CSS, include_bytes!("web/clay.css")),
    ("clay.js", SCRIPT, include_bytes!("web/clay.js")),
    ("clearance.js", SCRIPT, include_bytes!("web/clearance.js")),
    ("colors.js", SCRIPT, include_bytes!("web/colors.js")),
    ("download.js", SCRIPT, include_bytes!("web/download.js")),
    ("draw.js", SCRIPT, include_bytes!("web/draw.js")),
    ("drive.js", SCRIPT, include_bytes!("web/drive.js")),
    ("element.js", SCRIPT, include_bytes!("web/element.js")),
    ("export.js", SCRIPT, include_bytes!("web/export.js")),
    ("facts.js", SCRIPT, include_bytes!("web/facts.js")),
    ("frame.js", SCRIPT, include_bytes!("web/frame.js")),
    ("gamepad.js", SCRIPT, include_bytes!("web/gamepad.js")),
    ("hand.js", SCRIPT, include_bytes!("web/hand.js")),
    ("history.js", SCRIPT, include_bytes!("web/history.js")),
    ("link.js", SCRIPT, include_bytes!("web/link.js")),
    ("lod.js", SCRIPT, include_bytes!("web/lod.js")),
    ("look.js", SCRIPT, include_bytes!("web/look.js")),
    ("made-files.js", SCRIPT, include_bytes!("web/made-files.js")),
    ("main.js", SCRIPT, include_bytes!("web/main.js")),
    ("marks.js", SCRIPT, include_bytes!("web/marks.js")),
    ("material.js", SCRIPT, include_bytes!("web/material.js")),
    ("math.js", SCRIPT, include_bytes!("web/math.js")),
    ("measure.js", SCRIPT, include_bytes!("web/measure.js")),
    ("mesh-loader.js", SCRIPT, include_bytes!("web/mesh-loader.js")),
    ("mesh-worker.js", SCRIPT, include_bytes!("web/mesh-worker.js")),
    ("mesh.js", SCRIPT, include_bytes!("web/mesh.js")),
    ("number-field.js", SCRIPT, include_bytes!("web/number-field.js")),
    ("objects.js", SCRIPT, include_bytes!("web/objects.js")),
    ("pace.js", SCRIPT, include_bytes!("web/pace.js")),
    ("parameters.js", SCRIPT, include_bytes!("web/parameters.js")),
    ("parts.js", SCRIPT, include_bytes!("web/parts.js")),
    ("path-plot.js", SCRIPT, include_bytes!("web/path-plot.js")),
    ("path.js", SCRIPT, include_bytes!("web/path.js")),
    ("pick.js", SCRIPT, include_bytes!("web/pick.js")),
    ("plots.js", SCRIPT, include_bytes!("web/plots.js")),
    ("readouts.js", SCRIPT, include_bytes!("web/readouts.js")),
    ("scene.js", SCRIPT, include_bytes!("web/scene.js")),
    ("section.js", SCRIPT, include_bytes!("web/section.js")),
    ("session.js", SCRIPT, include_bytes!("web/session.js")),
    ("shaders.js", SCRIPT, include_bytes!("web/shaders.js")),
    ("shapes.js", SCRIPT, include_bytes!("web/shapes.js")),
    ("splat-shaders.js", SCRIPT, include_bytes!("web/splat-shaders.js")),
    ("splat-surface.js", SCRIPT, include_bytes!("web/splat-surface.js")),
    ("splats.js", SCRIPT, include_bytes!("web/splats.js")),
    ("structures.js", SCRIPT, include_bytes!("web/structures.js")),
    ("units.js", SCRIPT, include_bytes!("web/units.js")),
    ("unsaved.js", SCRIPT, include_bytes!("web/unsaved.js")),
    ("view.css", CSS, include_bytes!("web/view.css")),
    ("wrench.js", SCRIPT, include_bytes!("web/wrench.js")),
];

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SVG: &str = "image/svg+xml; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The files as they are sent, each from its first request on.
static SENT: [OnceLock<Compressed>; FILES.len()] = [const { OnceLock::new() }; FILES.len()];

/// Content type and bytes of a file.
pub(super) fn find(name: &str) -> Option<(&'static str, &'static Compressed)> {
    let (idx, (_, kind, bytes)) =
        FILES.iter().enumerate().find(|(_, (known, ..))| *known == name)?;
    Some((kind, SENT[idx].get_or_init(|| Compressed::new(Bytes::from_static(bytes)))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_page_is_served() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/monitor/web");
        let mut on_disk: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        let mut listed: Vec<_> = FILES.iter().map(|(name, ..)| (*name).to_owned()).collect();
        on_disk.sort();
        listed.sort();
        assert_eq!(listed, on_disk);
    }
}
