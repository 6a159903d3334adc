use std::io::Write;

use zip::write::SimpleFileOptions;

use super::*;
use crate::setting_names::SettingNames;

const TETRAHEDRON: &str = "<mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" \
    y=\"0\" z=\"0\"/><vertex x=\"0\" y=\"2\" z=\"0\"/><vertex x=\"0\" y=\"0\" \
    z=\"3\"/></vertices><triangles><triangle v1=\"0\" v2=\"2\" v3=\"1\"/><triangle v1=\"0\" \
    v2=\"1\" v3=\"3\"/><triangle v1=\"1\" v2=\"2\" v3=\"3\" pid=\"4\"/><triangle v1=\"2\" v2=\"0\" \
    v3=\"3\"></triangle></triangles></mesh>";

fn package(parts: &[(&str, &str)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, text) in parts {
        archive.start_file(*name, SimpleFileOptions::default()).unwrap();
        archive.write_all(text.as_bytes()).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn model(head: &str, resources: &str, build: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model {head} \
            xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"><metadata \
            name=\"Title\">a \
            &lt;part&gt;</metadata><resources>{resources}</resources><build>{build}</build></model>"
    )
}

fn object(id: u32, inside: &str) -> String {
    format!("<object id=\"{id}\" type=\"model\">{inside}</object>")
}

fn read_model(head: &str, resources: &str, build: &str) -> Result<TriangleMesh, MeshError> {
    read(&package(&[("3D/3dmodel.model", &model(head, resources, build))]))
}

fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    parse(bytes, Path::new("part.3mf"), 1e-3).map(|file| file.mesh)
}

#[test]
fn what_is_built_is_read_and_the_rest_is_not() {
    let resources = object(1, TETRAHEDRON) + &object(2, TETRAHEDRON);
    let mesh = read_model("unit=\"millimeter\"", &resources, "<item objectid=\"2\"/>").unwrap();
    assert_eq!(mesh.triangles, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    assert_eq!(mesh.vertices, [DVec3::ZERO, DVec3::X, DVec3::Y * 2.0, DVec3::Z * 3.0]);
}

#[test]
fn transforms_of_items_and_components_are_chained_and_mirrors_turn_triangles() {
    // The component moves by x, the item then turns a quarter about z; the second item mirrors.
    let resources = object(1, TETRAHEDRON)
        + &object(
            2,
            "<components><component objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 10 0 \
                0\"/></components>",
        );
    let build = "<item objectid=\"2\" transform=\"0 1 0 -1 0 0 0 0 1 0 0 5\"/><item objectid=\"1\" \
        transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/>";
    let mesh = read_model("", &resources, build).unwrap();
    assert_eq!(
        mesh.vertices[..4],
        [[0.0, 10.0, 5.0], [0.0, 11.0, 5.0], [-2.0, 10.0, 5.0], [0.0, 10.0, 8.0]]
            .map(DVec3::from_array)
    );
    assert_eq!(mesh.vertices[5], -DVec3::X);
    let report = crate::mesh::validate::inspect(&mesh);
    assert!(
        report.closed
            && report.inconsistent_edges == 0
            && (report.signed_volume_m3 - 2.0).abs() < 1e-12,
        "{report:?}"
    );
}

#[test]
fn parts_of_the_production_extension_are_followed() {
    let relations = "<Relationships \
        xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship \
        Id=\"rel0\" Target=\"/3D/main.model\" \
        Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>";
    let head = "xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\" \
        requiredextensions=\"p\"";
    let main = model(
        head,
        &object(
            7,
            "<components><component p:path=\"/3D/Objects/one.model\" objectid=\"1\"/></components>",
        ),
        "<item objectid=\"7\"/>",
    );
    let one = model("", &object(1, TETRAHEDRON), "");
    let bytes = package(&[
        ("_rels/.rels", relations),
        ("3D/main.model", &main),
        ("3D/Objects/one.model", &one),
    ]);
    assert_eq!(read(&bytes).unwrap().triangles.len(), 4);
    let error = read(&package(&[("_rels/.rels", relations), ("3D/main.model", &main)]))
        .unwrap_err()
        .to_string();
    assert!(error.starts_with("part.3mf: 3D/Objects/one.model: "), "{error}");
}

#[test]
fn units_must_agree() {
    let resources = object(1, TETRAHEDRON);
    for (unit, metres) in UNITS {
        let bytes = package(&[(
            "3D/3dmodel.model",
            &model(&format!("unit=\"{unit}\""), &resources, "<item objectid=\"1\"/>"),
        )]);
        assert_eq!(parse(&bytes, Path::new("part.3mf"), metres).unwrap().mesh.triangles.len(), 4);
        let error = parse(&bytes, Path::new("part.3mf"), 0.5).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("part.3mf: the file says {unit} ({metres} m), not 0.5 m")
        );
        let names = SettingNames { unit: "--units", ..SettingNames::PLAIN };
        assert!(error.hint(&names).is_some_and(|hint| hint.starts_with("set --units to ")));
    }
}

#[test]
fn errors_name_the_part_and_the_value() {
    let message =
        |resources: &str, build: &str| read_model("", resources, build).unwrap_err().to_string();
    let place = "part.3mf: 3D/3dmodel.model: ";
    assert_eq!(message("", "<item objectid=\"3\"/>"), format!("{place}object 3 is not there"));
    let text = message(&object(1, &TETRAHEDRON.replace("z=\"3\"", "z=\"3mm\"")), "");
    assert!(
        text.starts_with(&format!("{place}byte "))
            && text.ends_with("`z` must be a number, found `3mm`"),
        "{text}"
    );
    let text = message(&object(1, &TETRAHEDRON.replace("z=\"3\"", "z=\"nan\"")), "");
    assert!(text.ends_with("vertex 3 is not finite"), "{text}");
    let text = message(&object(1, &TETRAHEDRON.replace("v3=\"1\"", "v3=\"4\"")), "");
    assert!(
        text.ends_with("object 1: a triangle names vertex 4 (counted from 0), it has 4"),
        "{text}"
    );
    let text = message(&(object(1, TETRAHEDRON) + &object(1, TETRAHEDRON)), "");
    assert!(text.ends_with("object 1 stands there twice"), "{text}");
    let text = message(&object(1, TETRAHEDRON), "<item objectid=\"1\" transform=\"1 2 3\"/>");
    assert!(text.ends_with("`transform` must be twelve numbers, found `1 2 3`"), "{text}");
    let text = message(
        &object(1, "<components><component objectid=\"1\"/></components>"),
        "<item objectid=\"1\"/>",
    );
    assert!(text.ends_with("object 1 is 32 levels down, or in a loop"), "{text}");
    let lattice = "xmlns:b=\"http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02\" \
        requiredextensions=\"b\"";
    let text = read_model(lattice, "", "").unwrap_err().to_string();
    assert!(text.contains("beamlattice") && text.ends_with("export plain meshes"), "{text}");
    assert!(
        read_model("unit=\"furlong\"", "", "")
            .unwrap_err()
            .to_string()
            .ends_with("unknown unit `furlong`")
    );
    assert!(
        read(b"PK\x03\x04").unwrap_err().to_string().starts_with("part.3mf: not a 3MF package")
    );
}

#[test]
fn every_cut_is_an_error() {
    let whole = package(&[(
        "3D/3dmodel.model",
        &model("", &object(1, TETRAHEDRON), "<item objectid=\"1\"/>"),
    )]);
    assert_eq!(read(&whole).unwrap().triangles.len(), 4);
    for length in 0..whole.len() {
        assert!(read(&whole[..length]).is_err(), "{length}");
    }
}

#[test]
fn bombs_do_not_go_off() {
    // A thousand to one: blanks.
    let blanks = model("", &" ".repeat(20_000_000), "");
    let text = read(&package(&[("3D/3dmodel.model", &blanks)])).unwrap_err().to_string();
    assert!(text.contains("unpacks to far more than its size"), "{text}");
    // Ten times the one below, over thirty levels.
    let mut resources = object(1, TETRAHEDRON);
    for id in 2..30 {
        let components = format!("<component objectid=\"{}\"/>", id - 1).repeat(10);
        resources += &object(id, &format!("<components>{components}</components>"));
    }
    let error = read_model("", &resources, "<item objectid=\"29\"/>").unwrap_err();
    assert!(matches!(error, MeshError::TooManyCopies { .. }), "{error}");
}

/// The sentence on what is left out of a model whose item 1 is whole.
fn left_out(parts: &[(&str, &str)]) -> String {
    let file = parse(&package(parts), Path::new("part.3mf"), 1e-3).unwrap();
    assert_eq!(file.mesh.triangles, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    assert_eq!(file.notes.len(), 1, "{:?}", file.notes);
    file.notes[0].clone()
}

#[test]
fn supports_and_what_is_not_printed_are_left_out_and_named() {
    let of_type =
        |id: u32, more: &str| format!("<object id=\"{id}\" {more}>{TETRAHEDRON}</object>");
    let resources = object(1, TETRAHEDRON)
        + &of_type(2, "type=\"support\" name=\"tower\"")
        + &of_type(3, "type=\"other\"")
        + &of_type(4, "type=\"solidsupport\" name=\"a&#10;b\"")
        + &of_type(5, "type=\"model\" printable=\"0\" name=\"spare\"")
        // Within an object as well.
        + &object(6, "<components><component objectid=\"2\"/></components>");
    let build = "<item objectid=\"1\" printable=\"1\"/><item objectid=\"2\"/><item \
        objectid=\"3\"/><item objectid=\"4\"/><item objectid=\"5\"/><item objectid=\"1\" \
        printable=\"0\"/><item objectid=\"6\"/>";
    let model = model("", &resources, build);
    assert_eq!(
        left_out(&[("3D/3dmodel.model", &model)]),
        "5 objects are left out, as no part of what is printed: `tower` (type support), object 3 \
            (type other), `a\\nb` (type solidsupport), `spare` (not printable), object 1 (not \
            printable)"
    );
    let model = self::model("", &resources, "<item objectid=\"2\"/>");
    assert_eq!(
        read(&package(&[("3D/3dmodel.model", &model)])).unwrap_err().to_string(),
        "part.3mf: nothing of it is printed: 1 object is left out, as no part of what is printed: \
            `tower` (type support)"
    );
}

#[test]
fn modifiers_and_negative_volumes_of_slicers_are_left_out_and_named() {
    // PrusaSlicer has all volumes of an object in one mesh.
    let twice = TETRAHEDRON.replace(
        "</triangles>",
        "<triangle v1=\"0\" v2=\"2\" v3=\"1\"/><triangle v1=\"0\" v2=\"1\" v3=\"3\"/></triangles>",
    );
    let model = self::model("", &object(1, &twice), "<item objectid=\"1\"/>");
    let volume = |first: u32, last: u32, name: &str, key: &str, value: &str| {
        format!(
            "<volume firstid=\"{first}\" lastid=\"{last}\"><metadata type=\"volume\" key=\"name\" \
                value=\"{name}\"/><metadata type=\"volume\" key=\"{key}\" \
                value=\"{value}\"/></volume>"
        )
    };
    for (key, value, purpose) in [
        ("volume_type", "ParameterModifier", "modifier"),
        ("volume_type", "NegativeVolume", "negative volume, not subtracted"),
        ("volume_type", "SupportBlocker", "support blocker"),
        ("volume_type", "SupportEnforcer", "support enforcer"),
        ("modifier", "1", "modifier"),
    ] {
        let list = format!(
            "<config><object id=\"1\"><metadata type=\"object\" key=\"name\" value=\"all\"/>{}{}\
                </object></config>",
            volume(0, 3, "solid", "volume_type", "ModelPart"),
            volume(4, 5, "slot", key, value)
        );
        let parts =
            [("3D/3dmodel.model", &*model), ("Metadata/Slic3r_PE_model.config", list.as_str())];
        let expected =
            format!("1 object is left out, as no part of what is printed: `slot` ({purpose})");
        assert_eq!(left_out(&parts), expected);
    }
    // Bambu Studio and OrcaSlicer have an object for each.
    let resources = object(1, TETRAHEDRON)
        + &object(2, TETRAHEDRON)
        + &object(
            9,
            "<components><component objectid=\"1\"/><component objectid=\"2\"/></components>",
        );
    let model = self::model("", &resources, "<item objectid=\"9\"/>");
    for (subtype, purpose) in [
        ("modifier_part", "modifier"),
        ("negative_part", "negative volume, not subtracted"),
        ("support_blocker", "support blocker"),
        ("support_enforcer", "support enforcer"),
    ] {
        let list = format!(
            "<config><object id=\"9\"><metadata key=\"name\" value=\"all\"/><part id=\"1\" \
                subtype=\"normal_part\"><metadata key=\"name\" value=\"solid\"/></part><part \
                id=\"2\" subtype=\"{subtype}\"><metadata key=\"name\" value=\"slot\"/></part>\
                </object></config>"
        );
        let parts =
            [("3D/3dmodel.model", &*model), ("Metadata/model_settings.config", list.as_str())];
        let expected =
            format!("1 object is left out, as no part of what is printed: `slot` ({purpose})");
        assert_eq!(left_out(&parts), expected);
    }
}

#[test]
fn a_list_of_volumes_that_cannot_be_read_does_not_hide_the_model() {
    let model = self::model("", &object(1, TETRAHEDRON), "<item objectid=\"1\"/>");
    let list = "<config><object id=\"1\"><volume firstid=\"x\"/></object></config>";
    let note = left_out(&[("3D/3dmodel.model", &model), ("Metadata/Slic3r_PE_model.config", list)]);
    assert!(
        note.contains("may be in the mesh") && note.contains("`firstid` must be a number"),
        "{note}"
    );
}

#[test]
fn what_is_left_out_counts_as_a_copy_and_is_named_once() {
    let within = |id: u32, inside: u32, n_copies: usize| {
        let components = format!("<component objectid=\"{inside}\"/>").repeat(n_copies);
        object(id, &format!("<components>{components}</components>"))
    };
    let placed = |n_copies: usize| {
        let resources = object(1, TETRAHEDRON)
            + &format!("<object id=\"2\" type=\"support\" name=\"tower\">{TETRAHEDRON}</object>")
            + &within(3, 2, n_copies)
            + &within(4, 3, n_copies);
        model("", &resources, "<item objectid=\"1\"/><item objectid=\"4\"/>")
    };
    let expected =
        "1 object is left out, as no part of what is printed: `tower` (type support)".to_owned();
    assert_eq!(left_out(&[("3D/3dmodel.model", &placed(100))]), expected);
    // Four million of them.
    let error = read(&package(&[("3D/3dmodel.model", &placed(2000))])).unwrap_err();
    assert!(matches!(error, MeshError::TooManyCopies { .. }), "{error}");
    // Volumes of an object as well.
    let twice =
        TETRAHEDRON.replace("</triangles>", "<triangle v1=\"0\" v2=\"2\" v3=\"1\"/></triangles>");
    let items = "<item objectid=\"1\"/>".repeat(3);
    let model = self::model("", &object(1, &twice), &items);
    let list = "<config><object id=\"1\"><volume firstid=\"4\" lastid=\"4\"><metadata key=\"name\" \
        value=\"slot\"/><metadata key=\"modifier\" value=\"1\"/></volume></object></config>";
    let parts = [("3D/3dmodel.model", &*model), ("Metadata/Slic3r_PE_model.config", list)];
    let file = parse(&package(&parts), Path::new("part.3mf"), 1e-3).unwrap();
    assert_eq!(
        file.notes,
        ["1 object is left out, as no part of what is printed: `slot` (modifier)"]
    );
    assert_eq!(file.mesh.triangles.len(), 12);
}

/// A part with one object of so many triangles and components.
fn part_of(n_triangles: usize, n_components: u32) -> Part {
    let component = |id: u32| Placement {
        object: id,
        part: None,
        parent_from_object: DMat4::IDENTITY,
        name: None,
        not_printed: None,
    };
    let object = Object {
        mesh: TriangleMesh {
            triangles: (0..n_triangles as u32).map(|k| [k; 3]).collect(),
            ..TriangleMesh::default()
        },
        components: (0..n_components).map(component).collect(),
        ..Object::default()
    };
    Part { unit: UNITS[0], objects: HashMap::from([(1, object)]), items: Vec::new() }
}

fn modifier(first: usize, last: usize) -> slicer::Volume {
    slicer::Volume {
        triangles: Some(first..=last),
        purpose: Some("modifier"),
        ..slicer::Volume::default()
    }
}

#[test]
fn volumes_take_out_their_triangles_in_any_order() {
    // Overlapping, nested, the wrong way round, and beyond the end.
    let ranges = [(7, 9), (2, 4), (3, 3), (4, 5), (6, 1), (15, 14), (18, 40), (19, usize::MAX)];
    let mut part = part_of(20, 0);
    let volumes = ranges.map(|(first, last)| modifier(first, last));
    slicer::mark(&HashMap::from([(1, volumes.into())]), &mut part);
    let expected: Vec<_> = (0..20_u32)
        .filter(|k| !ranges.iter().any(|(first, last)| (*first..=*last).contains(&(*k as usize))))
        .map(|k| [k; 3])
        .collect();
    assert_eq!(part.objects[&1].mesh.triangles, expected);
}

#[test]
fn many_volumes_of_many_triangles_and_components_are_marked() {
    // Each volume for each triangle, or component, would be 4·10¹⁰ steps.
    const N: u32 = 200_000;
    let mut part = part_of(N as usize, N);
    let volumes = (0..N)
        .map(|k| slicer::Volume {
            component: Some(k),
            ..modifier(N as usize - 1 - k as usize / 2, N as usize - 1)
        })
        .collect();
    slicer::mark(&HashMap::from([(1, volumes)]), &mut part);
    let object = &part.objects[&1];
    assert_eq!(object.mesh.triangles.len(), N as usize / 2);
    assert!(object.components.iter().all(|placed| placed.not_printed == Some("modifier")));
}

#[test]
fn required_extensions_are_looked_up_not_searched_for() {
    // Each prefix for each attribute would be 10¹⁰ steps.
    const N: usize = 100_000;
    let attributes: String = (0..N).map(|k| format!("a{k}=\"\" ")).collect();
    let required = "p ".repeat(N);
    let head = format!(
        "{attributes} xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\" \
            requiredextensions=\"{required}\""
    );
    let model = model(&head, &object(1, TETRAHEDRON), "<item objectid=\"1\"/>");
    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    archive.start_file("3D/3dmodel.model", stored).unwrap();
    archive.write_all(model.as_bytes()).unwrap();
    let bytes = archive.finish().unwrap().into_inner();
    assert_eq!(read(&bytes).unwrap().triangles.len(), 4);
    // Namespaces are searched, so there are few of them, and their names are short.
    let namespaces: String = (0..200).map(|k| format!("xmlns:a{k}=\"b\" ")).collect();
    let text = read_model(&namespaces, "", "").unwrap_err().to_string();
    assert!(text.ends_with("more than 128 namespaces in one place; export plain meshes"), "{text}");
    let long = format!("xmlns:q=\"{}\" requiredextensions=\"q\"", "n".repeat(300));
    let text = read_model(&long, "", "").unwrap_err().to_string();
    assert!(text.ends_with("is longer than 256 bytes; export plain meshes"), "{text}");
}

const LATTICE: &str = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02";
const DISPLACEMENT: &str = "http://schemas.3mf.io/3dmanufacturing/displacement/2023/10";

#[test]
fn extensions_that_are_not_required_are_left_out_and_named() {
    let note = |prefix: &str, namespace: &str, resources: &str| {
        let head = format!("xmlns:{prefix}=\"{namespace}\"");
        left_out(&[("3D/3dmodel.model", &model(&head, resources, "<item objectid=\"1\"/>"))])
    };
    let said = |what: &str| {
        format!("left out, as their extensions are not read: {what}; export plain meshes")
    };
    let beams = "<b:beamlattice radius=\"1\" minlength=\"0.1\"><b:beams><b:beam v1=\"0\" \
        v2=\"1\"/></b:beams></b:beamlattice>";
    let lattice = TETRAHEDRON.replace("</mesh>", &format!("{beams}</mesh>"));
    assert_eq!(
        note("b", LATTICE, &object(1, &lattice)),
        said(&format!("`beamlattice` ({LATTICE})"))
    );
    // Its names are those of the standard, and what it holds may be of any namespace.
    let displaced = "<d:displacementmesh><d:vertices><d:vertex x=\"9\" y=\"9\" \
        z=\"9\"/></d:vertices><d:triangles><d:triangle v1=\"0\" v2=\"1\" \
        v3=\"4\"/></d:triangles><vertex x=\"9\" y=\"9\" z=\"9\"/></d:displacementmesh>";
    let displaced = object(1, &format!("{TETRAHEDRON}{displaced}")) + "<d:object id=\"1\"/>";
    assert_eq!(
        note("d", DISPLACEMENT, &displaced),
        said(&format!("`displacementmesh` ({DISPLACEMENT})"))
    );
    // An unknown one, without a prefix, and one whose prefix is declared nowhere.
    let others = object(1, TETRAHEDRON) + "<shape xmlns=\"a:&#10;b\"/><q:vertex/>";
    assert_eq!(note("d", DISPLACEMENT, &others), said("`shape` (a:&#10;b), `vertex` (q)"));
    // Nothing is left.
    let head = format!("xmlns:b=\"{LATTICE}\"");
    let text = read_model(&head, &object(1, beams), "<item objectid=\"1\"/>").unwrap_err();
    assert_eq!(
        text.to_string(),
        format!(
            "part.3mf: there is no plain mesh in it: {}",
            said(&format!("`beamlattice` ({LATTICE})"))
        )
    );
    // Colours are not missed.
    let head = "xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\"";
    let coloured = "<m:colorgroup id=\"2\"><m:color color=\"#ff0000\"/></m:colorgroup>".to_owned()
        + &object(1, TETRAHEDRON);
    let coloured = model(head, &coloured, "<item objectid=\"1\"/>");
    let bytes = package(&[("3D/3dmodel.model", &coloured)]);
    assert!(parse(&bytes, Path::new("part.3mf"), 1e-3).unwrap().notes.is_empty());
}

#[test]
fn names_count_with_their_namespace() {
    // The standard's own with a prefix, and attributes of others beside those of its own.
    let text = model("", &object(1, TETRAHEDRON), "<item objectid=\"1\"/>")
        .replace("</", "</c:")
        .replace('<', "<c:")
        .replace("<c:/", "</")
        .replace("<c:?", "<?")
        .replace("xmlns=", "xmlns:q=\"urn:other\" xmlns:c=")
        .replace("objectid=", "q:objectid=\"7\" q:path=\"/3D/none.model\" objectid=")
        .replace(" x=", " q:x=\"8\" x=");
    let mesh = read(&package(&[("3D/3dmodel.model", &text)])).unwrap();
    assert_eq!(mesh.triangles.len(), 4);
    assert_eq!(mesh.vertices, [DVec3::ZERO, DVec3::X, DVec3::Y * 2.0, DVec3::Z * 3.0]);
    // Another part would be taken for this one.
    let item = "<item p:path=\"/3D/other.model\" objectid=\"1\"/>";
    let text = read_model("", &object(1, TETRAHEDRON), item).unwrap_err().to_string();
    assert!(text.ends_with("the prefix of `p:path` is declared nowhere"), "{text}");
}
