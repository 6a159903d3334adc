//! What the target of the reader of recordings does with its bytes. The tests of the program
//! include this file and replay the corpus.

use std::io::Cursor;
use std::path::Path;

use recording::file::{Entry, Recording};
use recording::report::LabReport;

/// Reads the bytes as a recording and makes a page of it, as `hapticd report` does. Gives how many
/// ticks came out.
///
/// # Panics
/// Whenever a recording, however wrong, leads to a panic, or unpacks to more than it is.
pub(crate) fn exercise(bytes: &[u8]) -> usize {
    let mut recording = Recording::of(Cursor::new(bytes.to_vec()), Path::new("fuzz.mcap"));
    let mut page = LabReport::new("fuzz.mcap".to_owned());
    let mut n_ticks = 0;
    let mut n_brought = 0;
    while let Ok(Some(entry)) = recording.next_entry() {
        match &entry {
            Entry::Tick { .. } => n_ticks += 1,
            Entry::Attachment { name, data } => n_brought += name.len() + data.len(),
            Entry::Metadata { name, values } => {
                n_brought += name.len()
                    + values.iter().map(|(key, value)| key.len() + value.len()).sum::<usize>();
            }
        }
        page.take(&entry);
    }
    assert!(n_brought <= bytes.len(), "{n_brought} bytes out of {}", bytes.len());
    std::hint::black_box(page.page());
    n_ticks
}
