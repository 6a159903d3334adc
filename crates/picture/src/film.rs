//! Films as animated PNG (PNG, third edition, W3C 2025, section 11.3.6): browsers show them without
//! anything else, no colour is lost, and each frame says for itself how long it stands, so that a
//! film whose frames were left out keeps the time.
//!
//! Each frame holds only the pixels that differ from the one before; the rest is transparent.
//! Frames go to the file as they come. How many there are stands before the first of them, and is
//! put there at the end.
//!
//! Invariant: cold; memory for two frames, however long the film is.

use std::io::{self, Seek, SeekFrom, Write};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use tiny_skia::{Pixmap, PremultipliedColorU8};

const SIGNATURE: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Of every chunk but its data: length, kind, checksum.
const CHUNK_REST: usize = 12;
/// Behind the signature and the header with its 13 bytes: the chunk that says how many frames there
/// are.
const COUNT_AT: u64 = 8 + 13 + CHUNK_REST as u64;
const CHECKSUM: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);
/// A frame stands for at most so long, ms: the format has 16 bits for it.
const LONGEST_MS: i64 = u16::MAX as i64;

/// A film that is being written.
#[derive(Debug)]
pub struct Film<W> {
    file: W,
    /// The newest frame as it looks, and as it will stand in the file.
    newest: Option<NewestFrame>,
    n_frames: u32,
    /// Of the chunks of frames and of their data, counted together.
    sequence: u32,
}

#[derive(Debug)]
struct NewestFrame {
    time_ns: i64,
    looks: Pixmap,
    changes: Pixmap,
}

impl<W: Write + Seek> Film<W> {
    /// Into this file, from its beginning.
    pub fn new(file: W) -> Self {
        Self { file, newest: None, n_frames: 0, sequence: 0 }
    }

    /// Adds a frame. All of them have one size, and their times grow.
    ///
    /// # Errors
    /// The file takes no more.
    pub fn add(&mut self, time_ns: i64, looks: Pixmap) -> io::Result<()> {
        let changes = match self.newest.take() {
            None => looks.clone(),
            Some(before) => {
                let changes = changed(&before.looks, &looks);
                self.write(&before, time_ns - before.time_ns)?;
                changes
            }
        };
        self.newest = Some(NewestFrame { time_ns, looks, changes });
        Ok(())
    }

    /// Ends the film: the last frame stands for a second. Gives the file and how many frames it
    /// has.
    ///
    /// # Errors
    /// The file takes no more.
    pub fn finish(mut self) -> io::Result<(W, u32)> {
        if let Some(last) = self.newest.take() {
            self.write(&last, 1_000_000_000)?;
        }
        self.chunk(*b"IEND", &[])?;
        self.file.seek(SeekFrom::Start(COUNT_AT))?;
        self.count()?;
        self.file.flush()?;
        Ok((self.file, self.n_frames))
    }

    fn write(&mut self, frame: &NewestFrame, stands_ns: i64) -> io::Result<()> {
        let png = frame.changes.encode_png().map_err(io::Error::other)?;
        let chunks = Chunks(png.get(SIGNATURE.len()..).unwrap_or_default());
        if self.n_frames == 0 {
            // The header of a frame is that of the film.
            let header =
                chunks.clone().find(|(kind, _)| kind == b"IHDR").map_or(&[][..], |(_, data)| data);
            self.file.write_all(&SIGNATURE)?;
            self.chunk(*b"IHDR", header)?;
            self.count()?;
        }
        let delay_ms = ((stands_ns + 500_000) / 1_000_000).clamp(1, LONGEST_MS) as u16;
        let mut control = Vec::with_capacity(26);
        for number in [self.next_in_sequence(), frame.looks.width(), frame.looks.height(), 0, 0] {
            control.extend(number.to_be_bytes());
        }
        control.extend(delay_ms.to_be_bytes());
        control.extend(1000_u16.to_be_bytes());
        // The frame stays when the next one comes, which is put over it.
        control.extend([0, u8::from(self.n_frames > 0)]);
        self.chunk(*b"fcTL", &control)?;
        for (kind, data) in chunks {
            if kind == *b"IDAT" && self.n_frames == 0 {
                self.chunk(*b"IDAT", data)?;
            } else if kind == *b"IDAT" {
                let numbered = [&self.next_in_sequence().to_be_bytes(), data].concat();
                self.chunk(*b"fdAT", &numbered)?;
            }
        }
        self.n_frames += 1;
        Ok(())
    }

    /// How many frames there are, and that they are played again and again.
    fn count(&mut self) -> io::Result<()> {
        let data = [self.n_frames.to_be_bytes(), 0_u32.to_be_bytes()].concat();
        self.chunk(*b"acTL", &data)
    }

    fn next_in_sequence(&mut self) -> u32 {
        let number = self.sequence;
        self.sequence += 1;
        number
    }

    fn chunk(&mut self, kind: [u8; 4], data: &[u8]) -> io::Result<()> {
        let mut digest = CHECKSUM.digest();
        digest.update(&kind);
        digest.update(data);
        self.file.write_all(&(data.len() as u32).to_be_bytes())?;
        self.file.write_all(&kind)?;
        self.file.write_all(data)?;
        self.file.write_all(&digest.finalize().to_be_bytes())
    }
}

/// What to put over one picture to get the other.
fn changed(before: &Pixmap, now: &Pixmap) -> Pixmap {
    let mut changes = now.clone();
    for (pixel, before) in changes.pixels_mut().iter_mut().zip(before.pixels()) {
        if pixel == before {
            *pixel = PremultipliedColorU8::TRANSPARENT;
        }
    }
    changes
}

/// Kind and data of one chunk after the other, of a PNG file behind its signature.
#[derive(Clone)]
struct Chunks<'p>(&'p [u8]);

impl<'p> Iterator for Chunks<'p> {
    type Item = ([u8; 4], &'p [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let (length, rest) = self.0.split_first_chunk::<4>()?;
        let (kind, rest) = rest.split_first_chunk::<4>()?;
        let length = u32::from_be_bytes(*length) as usize;
        let data = rest.get(..length)?;
        self.0 = rest.get(length + 4..)?;
        Some((*kind, data))
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use tiny_skia::{Color, Paint, Rect, Transform};

    fn picture(x: f32) -> Pixmap {
        let mut pixels = Pixmap::new(40, 30).expect("pixels");
        pixels.fill(Color::WHITE);
        let mut paint = Paint::default();
        paint.set_color_rgba8(200, 30, 60, 255);
        pixels.fill_rect(
            Rect::from_xywh(x, 5.0, 8.0, 8.0).expect("a rectangle"),
            &paint,
            Transform::identity(),
            None,
        );
        pixels
    }

    /// Puts the frames of a film over one another as a viewer does; delays in ms.
    fn played(film: &[u8]) -> (u32, Vec<(u16, Pixmap)>) {
        assert_eq!(film[..8], SIGNATURE);
        let all: Vec<_> = Chunks(&film[8..]).collect();
        assert_eq!(&all[all.len() - 1].0, b"IEND");
        // Every chunk is whole: signature and chunks are all that there is.
        assert_eq!(
            8 + all.iter().map(|(_, data)| data.len() + CHUNK_REST).sum::<usize>(),
            film.len()
        );
        let header = all[0].1;
        let word =
            |data: &[u8], at: usize| u32::from_be_bytes(data[at..at + 4].try_into().expect("four"));
        assert_eq!((&all[1].0, word(all[1].1, 4)), (b"acTL", 0));
        let mut sequence = 0;
        let mut frames = Vec::new();
        let mut canvas = None::<Pixmap>;
        let mut n = 2;
        while n + 1 < all.len() {
            let (kind, control) = all[n];
            assert_eq!((&kind, word(control, 0), control.len()), (b"fcTL", sequence, 26));
            assert_eq!(
                [word(control, 4), word(control, 8), word(control, 12), word(control, 16)],
                [40, 30, 0, 0]
            );
            sequence += 1;
            n += 1;
            let mut still = SIGNATURE.to_vec();
            let mut put = |kind: &[u8; 4], data: &[u8]| {
                let mut cursor = Film::new(Cursor::new(Vec::new()));
                cursor.chunk(*kind, data).expect("memory");
                still.extend(cursor.file.into_inner());
            };
            put(b"IHDR", header);
            while n < all.len() && (&all[n].0 == b"IDAT" || &all[n].0 == b"fdAT") {
                let (kind, mut data) = all[n];
                assert_eq!(&kind == b"IDAT", frames.is_empty());
                if &kind == b"fdAT" {
                    assert_eq!(word(data, 0), sequence);
                    sequence += 1;
                    data = &data[4..];
                }
                put(b"IDAT", data);
                n += 1;
            }
            put(b"IEND", &[]);
            let still = Pixmap::decode_png(&still).expect("a frame");
            let mut looks = canvas.take().unwrap_or_else(|| still.clone());
            for (pixel, new) in looks.pixels_mut().iter_mut().zip(still.pixels()) {
                if new.alpha() == 255 {
                    *pixel = *new;
                }
            }
            assert_eq!(control[25], u8::from(!frames.is_empty()));
            frames.push((u16::from_be_bytes([control[20], control[21]]), looks.clone()));
            canvas = Some(looks);
        }
        (word(all[1].1, 0), frames)
    }

    #[test]
    fn a_film_shows_its_frames_for_as_long_as_they_stood() {
        let times_ms = [0, 40, 80, 200, 100_000];
        let mut film = Film::new(Cursor::new(Vec::new()));
        for (n, time_ms) in times_ms.into_iter().enumerate() {
            film.add(time_ms * 1_000_000, picture(n as f32 * 6.0)).expect("memory");
        }
        let (file, n_frames) = film.finish().expect("memory");
        let (counted, frames) = played(&file.into_inner());
        assert_eq!((n_frames, counted, frames.len()), (5, 5, 5));
        let delays: Vec<u16> = frames.iter().map(|(delay_ms, _)| *delay_ms).collect();
        assert_eq!(delays, [40, 40, 120, 65_535, 1000]);
        for (n, (_, looks)) in frames.iter().enumerate() {
            assert!(looks.data() == picture(n as f32 * 6.0).data(), "frame {n}");
        }
    }

    #[test]
    fn a_frame_that_changes_nothing_takes_next_to_no_room() {
        let length = |n: i64| {
            let mut film = Film::new(Cursor::new(Vec::new()));
            (0..n).for_each(|time| film.add(time * 40_000_000, picture(3.0)).expect("memory"));
            film.finish().expect("memory").0.into_inner().len()
        };
        assert!(length(2) - length(1) < 150, "{} bytes", length(2) - length(1));
        assert_eq!(
            played(&{
                let film = Film::new(Cursor::new(Vec::new()));
                let mut film = film;
                film.add(0, picture(0.0)).expect("memory");
                film.finish().expect("memory").0.into_inner()
            })
            .0,
            1
        );
    }
}
