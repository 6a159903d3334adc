//! The page, embedded in the program: one line for each file of `web/`.

/// Name below `/web/`, content type, bytes.
pub(super) const FILES: &[(&str, &str, &[u8])] = &[
    ("index.html", HTML, include_bytes!("web/index.html")),
    ("style.css", CSS, include_bytes!("web/style.css")),
    ("icon.svg", SVG, include_bytes!("web/icon.svg")),
    ("camera.js", SCRIPT, include_bytes!("web/camera.js")),
    ("clay-hand.js", SCRIPT, include_bytes!("web/clay-hand.js")),
    ("clay.css", CSS, include_bytes!("web/clay.css")),
    ("clay.js", SCRIPT, include_bytes!("web/clay.js")),
    ("colors.js", SCRIPT, include_bytes!("web/colors.js")),
    ("draw.js", SCRIPT, include_bytes!("web/draw.js")),
    ("drive.js", SCRIPT, include_bytes!("web/drive.js")),
    ("element.js", SCRIPT, include_bytes!("web/element.js")),
    ("facts.js", SCRIPT, include_bytes!("web/facts.js")),
    ("gamepad.js", SCRIPT, include_bytes!("web/gamepad.js")),
    ("hand.js", SCRIPT, include_bytes!("web/hand.js")),
    ("history.js", SCRIPT, include_bytes!("web/history.js")),
    ("link.js", SCRIPT, include_bytes!("web/link.js")),
    ("main.js", SCRIPT, include_bytes!("web/main.js")),
    ("material.js", SCRIPT, include_bytes!("web/material.js")),
    ("math.js", SCRIPT, include_bytes!("web/math.js")),
    ("mesh-loader.js", SCRIPT, include_bytes!("web/mesh-loader.js")),
    ("mesh-worker.js", SCRIPT, include_bytes!("web/mesh-worker.js")),
    ("mesh.js", SCRIPT, include_bytes!("web/mesh.js")),
    ("objects.js", SCRIPT, include_bytes!("web/objects.js")),
    ("parameters.js", SCRIPT, include_bytes!("web/parameters.js")),
    ("plots.js", SCRIPT, include_bytes!("web/plots.js")),
    ("readouts.js", SCRIPT, include_bytes!("web/readouts.js")),
    ("scene.js", SCRIPT, include_bytes!("web/scene.js")),
    ("session.js", SCRIPT, include_bytes!("web/session.js")),
    ("shaders.js", SCRIPT, include_bytes!("web/shaders.js")),
    ("shapes.js", SCRIPT, include_bytes!("web/shapes.js")),
    ("splats.js", SCRIPT, include_bytes!("web/splats.js")),
    ("units.js", SCRIPT, include_bytes!("web/units.js")),
    ("unsaved.js", SCRIPT, include_bytes!("web/unsaved.js")),
];

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SVG: &str = "image/svg+xml; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Content type and bytes of a file.
pub(super) fn find(name: &str) -> Option<(&'static str, &'static [u8])> {
    FILES.iter().find(|(known, ..)| *known == name).map(|(_, kind, bytes)| (*kind, *bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_page_is_served() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/monitor/web");
        let mut on_disk: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        let mut listed: Vec<_> = FILES.iter().map(|(name, ..)| (*name).to_owned()).collect();
        on_disk.sort();
        listed.sort();
        assert_eq!(listed, on_disk);
    }
}
