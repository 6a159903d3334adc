//! What one file of the cache holds.

use std::io::{self, Write};
use std::sync::Arc;

use super::GENERATION;
use vps::mesh::mass::MassProperties;
use vps::part::{ObjectReport, PartRole};
use vps::pointshell::shell::Shell;
use vps::storage::MappedFile;
use vps::storage::sections::{Key, Reader, Refusal, Writer};
use vps::voxmap::field::Field;

/// A baked object: what the tick reads of it, and its figures.
#[derive(Debug)]
pub struct Baked {
    /// What the tool touches; `None` for a mere tool.
    pub field: Option<Field>,
    /// What touches; `None` for a mere static object.
    pub shell: Option<Shell>,
    /// Volume, centre and inertia, beside the shell.
    pub mass: Option<MassProperties>,
    /// Figures. What depends on the scene (such as where the tool starts) is not in it.
    pub report: ObjectReport,
}

impl Baked {
    /// True when everything is there that an object of this role needs.
    pub fn serves(&self, role: PartRole) -> bool {
        let as_static = self.field.is_some();
        let as_tool = self.shell.is_some() && self.mass.is_some();
        match role {
            PartRole::Static => as_static,
            PartRole::Tool => as_tool,
            PartRole::Mesh => as_static && as_tool,
        }
    }

    /// Size of the arrays, bytes.
    pub(in crate::scene) fn heap_bytes(&self) -> usize {
        self.field.as_ref().map_or(0, Field::heap_bytes)
            + self.shell.as_ref().map_or(0, Shell::heap_bytes)
    }

    /// Writes the file of this object.
    ///
    /// # Errors
    /// Any error of `out`.
    pub fn write_to(&self, key: Key, out: &mut impl Write) -> io::Result<()> {
        let Self { field, shell, mass, report } = self;
        let report = serde_json::to_vec(report)?;
        let field_head = field.as_ref().map(Field::head);
        let shell_head = shell.as_ref().map(Shell::head);
        let mass = mass.as_ref().map(MassProperties::record);
        let mut file = Writer::default();
        file.array("report", &report);
        if let Some((field, head)) = field.as_ref().zip(field_head.as_ref()) {
            field.store(head, &mut file);
        }
        if let Some((shell, head)) = shell.as_ref().zip(shell_head.as_ref()) {
            shell.store(head, &mut file);
        }
        if let Some(mass) = &mass {
            MassProperties::store(mass, &mut file);
        }
        file.write_to(key, GENERATION, out)
    }
}

/// Reads a file of the cache from memory, whatever its key: for fuzzing.
///
/// # Errors
/// Everything that is not a sound file of this version.
pub fn read(bytes: &[u8]) -> Result<Baked, Refusal> {
    take(MappedFile::copy(bytes)?, None)
}

pub(super) fn take(mapped: Arc<MappedFile>, key: Option<Key>) -> Result<Baked, Refusal> {
    let file = Reader::new(mapped, key, GENERATION)?;
    let report = serde_json::from_slice(&file.array::<u8>("report")?)
        .map_err(|_| Refusal::Damaged("report"))?;
    let field = Field::is_in(&file).then(|| Field::load(&file)).transpose()?;
    let shell = Shell::is_in(&file).then(|| Shell::load(&file)).transpose()?;
    let mass = MassProperties::is_in(&file).then(|| MassProperties::load(&file)).transpose()?;
    Ok(Baked { field, shell, mass, report })
}
