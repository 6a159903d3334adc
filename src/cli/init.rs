//! `hapticd init`: a first scene for a folder of meshes, or for clay.

mod clay;
mod place;

use std::ffi::OsStr;
use std::fs;
use std::path::{Component, Path, PathBuf};

use self::place::SceneDestination;
use super::error::{CliError, Outcome};
use super::units::UnitArg;
use super::{OutputOptions, report};
use crate::config::draft::{self, Draft, DraftPart, DraftPath, DraftTool};
use crate::config::setting_names::KEYS;
use crate::error::Exit;
use document::show;
use vps::mesh::validate::inspect;
use vps::mesh::{self, EXTENSIONS, FileMesh, Format, MeshError, TriangleMesh};
use vps::storage::whole_file::write_bytes;

/// Arguments of `hapticd init`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with mesh files (.obj, .stl, .ply, .gltf, .glb, .3mf); folders in it are not
    /// searched. Or one file of points or a mesh, with --clay.
    #[arg(value_name = "FOLDER|FILE")]
    folder: PathBuf,
    /// Make the file clay, for `hapticd sculpt`.
    #[arg(long)]
    clay: bool,
    /// Scene file to write, or - for stdout, to be kept in the working directory [default:
    /// scene.toml in the folder; with --clay the name of the file].
    #[arg(short, long, alias = "output", value_name = "SCENE.toml")]
    out: Option<PathBuf>,
    /// The part that moves [default: the smallest].
    #[arg(long, value_name = "FILE")]
    tool: Option<PathBuf>,
    /// Unit of the numbers in the mesh files, except 3MF, which names its own [default: guessed
    /// from their size].
    #[arg(long, value_name = "UNIT")]
    units: Option<UnitArg>,
    /// Write over a scene that is there.
    #[arg(long, alias = "force")]
    overwrite: bool,
}

/// A mesh file as it was read.
struct InputMesh {
    path: PathBuf,
    /// What the file itself says of its unit.
    own_unit: Option<draft::Unit>,
    /// In units of the file; in metres where it names its own.
    mesh: TriangleMesh,
    /// What a user should know of the file.
    notes: Vec<String>,
}

impl InputMesh {
    fn new(path: PathBuf, own_unit: Option<draft::Unit>, file: FileMesh) -> Self {
        let FileMesh { mesh, notes, .. } = file;
        Self { path, own_unit, mesh, notes }
    }
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    if args.clay || args.folder.is_file() { clay::init(args, output) } else { init(args, output) }?;
    Ok(Exit::Ok)
}

fn init(args: &Args, output: OutputOptions) -> Result<(), CliError> {
    let shown = args.folder.display();
    let place = SceneDestination::of(args, || args.folder.join("scene.toml"))?;
    let files = mesh_files(&args.folder).map_err(|error| {
        CliError::asset(format_args!("{shown}: cannot be read: {error}"))
            .hint("name a folder with mesh files")
    })?;
    if files.is_empty() {
        let hint = if has_cad(&args.folder) {
            mesh::cad_hint(&KEYS)
        } else {
            format!("files that end in {} are read", EXTENSIONS.join(", "))
        };
        return Err(CliError::asset(format_args!("{shown}: no mesh files here")).hint(&*hint));
    }
    place.check_free(args)?;
    let mut found = Vec::new();
    for path in &files {
        match read(path) {
            Ok(read) => found.push(read),
            // One by one: the others make a scene all the same.
            Err(error) => report::warning(&format!("{error}; it is left out"), output),
        }
    }
    if found.is_empty() {
        let message = format!("{shown}: none of its meshes can be read");
        return Err(CliError::asset(message));
    }
    let index = |tool: &PathBuf| {
        index_of(tool, &args.folder, &found).ok_or_else(|| {
            let known: Vec<_> =
                found.iter().map(|found| found.path.display().to_string()).collect();
            let hint = format!("meshes that can be read: {}", known.join(", "));
            CliError::usage(format_args!("--tool {}: no mesh of the folder", tool.display()))
                .hint(&*hint)
        })
    };
    let tool_idx = args.tool.as_ref().map(index).transpose()?;
    if tool_idx.is_some() && found.len() == 1 {
        return Err(CliError::usage(
            "the folder has one part only: nothing is left for it to touch",
        )
        .hint("without --tool the part stands, and a ball touches it"));
    }
    let (unit, why) = unit(args, &found, output);
    let folder = place.folder();
    let mut parts = Vec::new();
    for InputMesh { path, own_unit, mut mesh, notes } in found {
        let file = relative(&path, folder)?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if own_unit.is_none() {
            mesh.vertices.iter_mut().for_each(|vertex| *vertex *= unit.metres());
        }
        for warning in notes.into_iter().chain(inspect(&mesh).warnings(&KEYS)) {
            report::warning(&format!("{}: {warning}", path.display()), output);
        }
        parts.push(DraftPart::new(file, stem, own_unit.unwrap_or(unit), &mesh));
    }
    let name = args
        .folder
        .canonicalize()
        .ok()
        .and_then(|folder| Some(folder.file_name()?.to_str()?.to_owned()));
    let Some(draft) = Draft::new(name.as_deref().unwrap_or("scene"), parts, tool_idx) else {
        // True invariant: there is at least one part.
        unreachable!("a draft of no parts");
    };
    let hand = place.hand();
    let named = hand.as_deref().and_then(Path::file_name).and_then(OsStr::to_str);
    let text = draft.text(&place.named(), &why, named);
    let mut reported = summary(&draft);
    if let (Some(hand), Some(named)) = (&hand, named) {
        write_bytes(hand, draft.hand_csv().as_bytes())
            .map_err(|error| CliError::write(hand.display(), &error))?;
        reported += &match draft.path() {
            DraftPath::Assembly => {
                format!(
                    "hand    {named}: into the place where its file puts {}, and out again\n",
                    tool_name(&draft)
                )
            }
            DraftPath::Tour => {
                format!("hand    {named}: onto the parts from above and from four sides\n")
            }
        };
    }
    place.write(&text, &reported, ("run", "renders"), output)
}

fn tool_name(draft: &Draft) -> &str {
    match draft.tool() {
        DraftTool::Part(part) => &part.name,
        DraftTool::Ball(_) => "the ball",
    }
}

/// What was made of the folder, a line each.
fn summary(draft: &Draft) -> String {
    let mm = |metres: f64| show(metres * 1e3);
    let mut text = match draft.tool() {
        DraftTool::Part(part) => format!(
            "tool    {} ({}), points every {} mm\n",
            part.name,
            part.file,
            mm(draft.tool_voxel_m())
        ),
        DraftTool::Ball(radius_m) => {
            format!("tool    a ball with a radius of {} mm\n", mm(*radius_m))
        }
    };
    for (part, voxel_m) in draft.statics() {
        text += &format!("static  {} ({}), voxels of {} mm\n", part.name, part.file, mm(*voxel_m));
    }
    if draft.scale() != 1.0 {
        text += &format!(
            "scale   {}: the parts are larger than the space of the arm's grip\n",
            draft.scale()
        );
    }
    text + &format!("memory  {}\n", draft::memory_text(draft.memory_bytes()))
}

/// Mesh files of a folder, sorted. Of files that differ in their ending only, the first one in the
/// order of [`EXTENSIONS`].
fn mesh_files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if Format::of(&path).is_ok() && !path.is_dir() {
            files.push(path);
        }
    }
    let rank = |path: &PathBuf| {
        let ending = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        EXTENSIONS.iter().position(|known| *known == ending)
    };
    files.sort_by_key(|path| (path.file_stem().map(OsStr::to_owned), rank(path)));
    files.dedup_by(|later, earlier| later.file_stem() == earlier.file_stem());
    Ok(files)
}

/// The folder has files of CAD programs.
fn has_cad(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|entries| {
        entries.flatten().any(|entry| mesh::cad_format(&entry.path()).is_some())
    })
}

/// 3MF is the one format whose files say what their numbers mean, and glTF the one that says it for
/// all of its files.
fn read(path: &Path) -> Result<InputMesh, MeshError> {
    let path = path.to_owned();
    match Format::of(&path)? {
        Format::Gltf => {
            let file = mesh::load_with_notes(&path, 1.0)?;
            Ok(InputMesh::new(path, Some(draft::Unit::M), file))
        }
        Format::ThreeMf => {
            let tried = draft::Unit::ALL
                .into_iter()
                .map(|unit| (unit, mesh::load_with_notes(&path, unit.metres())));
            let mut first = None;
            for (unit, read) in tried {
                match read {
                    Ok(file) => return Ok(InputMesh::new(path, Some(unit), file)),
                    Err(error) => first = first.or(Some(error)),
                }
            }
            // True invariant: there are units.
            Err(first.unwrap_or(MeshError::NoBytes { path }))
        }
        Format::Obj | Format::Stl | Format::Ply => {
            let file = mesh::load_with_notes(&path, 1.0)?;
            Ok(InputMesh::new(path, None, file))
        }
    }
}

/// The unit of all files that do not say it, and why, as a comment.
fn unit(args: &Args, found: &[InputMesh], output: OutputOptions) -> (draft::Unit, String) {
    if let Some(UnitArg(unit)) = args.units {
        return (unit, "of the mesh file".to_owned());
    }
    let longest = found.iter().filter(|found| found.own_unit.is_none()).filter_map(|found| {
        let (low, high) = found.mesh.bounds()?;
        Some((high - low).max_element())
    });
    let Some(longest) = longest.reduce(f64::max) else {
        return (draft::Unit::Mm, "of the mesh file".to_owned());
    };
    guessed(longest, "the largest part", output)
}

/// The likely unit where the longest edge of something has so many, and why, as a comment.
fn guessed(longest: f64, what: &str, output: OutputOptions) -> (draft::Unit, String) {
    let unit = draft::Unit::guess(longest);
    let length = format!("{} {}", show(longest), unit.name());
    report::note(
        &format!(
            "units are taken as {}: {what} is then {length} long; --units says otherwise",
            unit.name()
        ),
        output,
    );
    (unit, format!("of the file; guessed: {what} is then {length} long"))
}

fn index_of(tool: &Path, folder: &Path, found: &[InputMesh]) -> Option<usize> {
    // As the shell completes it, or as the folder has it.
    let wanted = [tool.canonicalize(), folder.join(tool).canonicalize()];
    found.iter().position(|found| {
        found
            .path
            .canonicalize()
            .is_ok_and(|path| wanted.iter().flatten().any(|wanted| *wanted == path))
    })
}

/// A file as a scene in `folder` names it: relative to it, in UTF-8.
fn relative(file: &Path, folder: &Path) -> Result<String, CliError> {
    relative_path(file, folder).ok_or_else(|| {
        let (file, folder) = (file.display(), folder.display());
        CliError::asset(format_args!("{file}: a scene in {folder} cannot name this file"))
            .hint("the folder of the scene must exist, and names must be UTF-8")
    })
}

fn relative_path(file: &Path, folder: &Path) -> Option<String> {
    let parent = file
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
        .canonicalize()
        .ok()?;
    let folder = folder.canonicalize().ok()?;
    let shared = parent.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let mut relative: PathBuf = up.chain(parent.components().skip(shared)).collect();
    relative.push(file.file_name()?);
    relative.to_str().map(str::to_owned)
}
