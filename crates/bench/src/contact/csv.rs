//! Raw results as files, or nowhere.

use core::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use super::super::BenchError;

/// A folder for results; without one, nothing is written.
#[derive(Debug)]
pub struct Csv(Option<PathBuf>);

/// One table under way.
pub(super) struct CsvFile(Option<(PathBuf, BufWriter<File>)>);

impl Csv {
    /// Makes the folder where it is missing.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn new(folder: Option<PathBuf>) -> Result<Self, BenchError> {
        if let Some(path) = &folder {
            std::fs::create_dir_all(path)
                .map_err(|source| BenchError::Write { path: path.clone(), source })?;
        }
        Ok(Self(folder))
    }

    pub(super) fn file(&mut self, name: &str, header: &str) -> Result<CsvFile, BenchError> {
        let Some(folder) = &self.0 else { return Ok(CsvFile(None)) };
        let path = folder.join(name);
        let file = File::create(&path)
            .map_err(|source| BenchError::Write { path: path.clone(), source })?;
        let mut file = CsvFile(Some((path, BufWriter::new(file))));
        file.line(format_args!("{header}"))?;
        Ok(file)
    }
}

impl CsvFile {
    pub(super) fn line(&mut self, line: fmt::Arguments<'_>) -> Result<(), BenchError> {
        self.with(|file| writeln!(file, "{line}"))
    }

    pub(super) fn finish(mut self) -> Result<(), BenchError> {
        self.with(|file| file.flush())
    }

    fn with(
        &mut self,
        write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), BenchError> {
        let Some((path, file)) = &mut self.0 else { return Ok(()) };
        write(file).map_err(|source| BenchError::Write { path: path.clone(), source })
    }
}
