//! Grey images for embossing: distances to what is drawn, turned into greys with a soft rim, so
//! that the slope up to white is gentle.
//!
//! Square roots and the four operations only: the same greys on every machine. PNG files hold them
//! as they are (stored blocks), so no version of a compressor shows in the bytes.

use crc::{CRC_32_ISO_HDLC, Crc};
use glam::DVec2;

/// A grey-scale image under construction: rows from the top, 0 black to 255 white.
pub(crate) struct Image {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) greys: Vec<u8>,
}

impl Image {
    /// White where `inside` is above `rim`, black below −`rim`, smooth between; `inside` gets the
    /// middles of pixels.
    fn of(width: usize, height: usize, rim: f64, inside: impl Fn(DVec2) -> f64) -> Self {
        let grey = |pixel: usize| {
            let middle = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let share = (0.5 + 0.5 * inside(middle) / rim).clamp(0.0, 1.0);
            (255.0 * share * share * (3.0 - 2.0 * share)).round() as u8
        };
        Self { width, height, greys: (0..width * height).map(grey).collect() }
    }

    /// The file.
    pub(crate) fn to_png(&self) -> Vec<u8> {
        let number =
            |value: usize| u32::try_from(value).expect("an image of less than 4 GiB").to_be_bytes();
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        let mut chunk = |name: &[u8; 4], content: &[u8]| {
            bytes.extend(number(content.len()));
            let named = [name.as_slice(), content].concat();
            bytes.extend(&named);
            bytes.extend(Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&named).to_be_bytes());
        };
        // Eight bits, grey, no interlacing.
        chunk(
            b"IHDR",
            &[number(self.width).as_slice(), &number(self.height), &[8, 0, 0, 0, 0]].concat(),
        );
        let rows: Vec<u8> = self
            .greys
            .chunks_exact(self.width)
            .flat_map(|row| std::iter::once(&0).chain(row))
            .copied()
            .collect();
        let mut stream = vec![0x78, 0x01];
        let blocks: Vec<&[u8]> = rows.chunks(usize::from(u16::MAX)).collect();
        for (n, block) in blocks.iter().enumerate() {
            let length = u16::try_from(block.len()).expect("a block of at most 65,535 bytes");
            stream.push(u8::from(n + 1 == blocks.len()));
            stream.extend(length.to_le_bytes());
            stream.extend((!length).to_le_bytes());
            stream.extend(*block);
        }
        stream.extend(adler_32(&rows).to_be_bytes());
        chunk(b"IDAT", &stream);
        chunk(b"IEND", &[]);
        bytes
    }
}

/// Check sum of a zlib stream (RFC 1950).
fn adler_32(bytes: &[u8]) -> u32 {
    let (low, high) = bytes.iter().fold((1, 0), |(low, high), byte| {
        ((low + u32::from(*byte)) % 65_521, (high + low + u32::from(*byte)) % 65_521)
    });
    high << 16 | low
}

fn distance_to_segment(point: DVec2, [from, to]: [DVec2; 2]) -> f64 {
    let way = to - from;
    let along = ((point - from).dot(way) / way.length_squared()).clamp(0.0, 1.0);
    point.distance(from + way * along)
}

/// Pixels of the letter's image along an edge.
pub(crate) const LETTER_PIXELS: usize = 128;
/// Middle line of the letter, pixels from the upper left corner: its stem, and the arch with its
/// leg.
pub(crate) const STEM: [DVec2; 2] = [DVec2::new(40.0, 16.0), DVec2::new(40.0, 112.0)];
pub(crate) const ARCH_CENTER: DVec2 = DVec2::new(64.0, 74.0);
pub(crate) const ARCH_RADIUS: f64 = 24.0;
/// Half the width of its strokes, and half the width of their rim, pixels.
const STROKE: f64 = 8.5;
const LETTER_RIM: f64 = 3.0;

/// The letter h.
pub(crate) fn letter() -> Image {
    let leg_top = ARCH_CENTER + DVec2::new(ARCH_RADIUS, 0.0);
    let leg = [leg_top, DVec2::new(leg_top.x, STEM[1].y)];
    Image::of(LETTER_PIXELS, LETTER_PIXELS, LETTER_RIM, |pixel| {
        let arch = if pixel.y < ARCH_CENTER.y {
            (pixel.distance(ARCH_CENTER) - ARCH_RADIUS).abs()
        } else {
            f64::INFINITY
        };
        STROKE - distance_to_segment(pixel, STEM).min(distance_to_segment(pixel, leg)).min(arch)
    })
}

/// Pixels of the map of the world, and half the width of its coasts, degrees.
const MAP: [usize; 2] = [192, 96];
const COAST_DEG: f64 = 2.2;

/// The world, longitude −180° to 180° to the right, latitude 90° to −90° downward: land is white.
pub(crate) fn continents() -> Image {
    let size = DVec2::new(MAP[0] as f64, MAP[1] as f64);
    Image::of(MAP[0], MAP[1], COAST_DEG, |pixel| {
        let place = DVec2::new(pixel.x / size.x * 360.0 - 180.0, 90.0 - pixel.y / size.y * 180.0);
        LANDS.iter().map(|land| inside_deg(place, land)).fold(f64::NEG_INFINITY, f64::max)
    })
}

/// How far inside of an outline a place is, degrees; below 0 outside.
fn inside_deg(place: DVec2, outline: &[[i16; 2]]) -> f64 {
    let corner = |n: usize| DVec2::from(outline[n % outline.len()].map(f64::from));
    let edges = || (0..outline.len()).map(|n| [corner(n), corner(n + 1)]);
    let is_crossed = |[from, to]: &[DVec2; 2]| {
        (from.y > place.y) != (to.y > place.y)
            && place.x < from.x + (to.x - from.x) * (place.y - from.y) / (to.y - from.y)
    };
    let is_inside = edges().filter(is_crossed).count() % 2 == 1;
    let distance =
        edges().map(|edge| distance_to_segment(place, edge)).fold(f64::INFINITY, f64::min);
    if is_inside { distance } else { -distance }
}

/// Outlines of lands, longitude and latitude, degrees; drawn by hand, coarse.
#[rustfmt::skip]
const LANDS: [&[[i16; 2]]; 18] = [
    // North and Central America.
    &[[-168, 66], [-156, 71], [-128, 70], [-95, 70], [-82, 68], [-94, 59], [-80, 52], [-77, 62], [-64, 59], [-56, 52], [-66, 45], [-70, 42],
      [-76, 35], [-81, 31], [-80, 26], [-83, 29], [-90, 30], [-97, 27], [-97, 20], [-91, 18], [-87, 21], [-88, 16], [-83, 11], [-78, 7],
      [-85, 9], [-95, 15], [-105, 19], [-110, 24], [-114, 30], [-120, 34], [-124, 41], [-124, 48], [-134, 57], [-146, 61], [-160, 56],
      [-166, 61]],
    // Greenland.
    &[[-73, 78], [-60, 82], [-30, 83], [-18, 76], [-24, 70], [-40, 65], [-44, 60], [-52, 65], [-55, 70], [-68, 76]],
    // South America.
    &[[-79, 8], [-72, 12], [-62, 10], [-52, 5], [-50, 0], [-35, -6], [-39, -14], [-41, -22], [-48, -26], [-53, -33], [-58, -38], [-65, -42],
      [-66, -48], [-68, -55], [-74, -52], [-73, -40], [-71, -30], [-70, -18], [-77, -13], [-81, -5], [-80, 1]],
    // Africa.
    &[[-6, 36], [10, 37], [20, 32], [32, 31], [35, 26], [38, 18], [43, 12], [51, 12], [47, 4], [40, -4], [40, -14], [35, -20], [33, -27],
      [26, -34], [19, -34], [15, -26], [12, -16], [13, -6], [9, 2], [4, 6], [-8, 4], [-13, 9], [-17, 15], [-16, 22], [-10, 30]],
    // Europe and Asia, along the south and back along the north.
    &[[-9, 43], [-9, 37], [-5, 36], [0, 39], [4, 43], [9, 44], [13, 41], [17, 37], [19, 42], [23, 36], [27, 37], [36, 36], [35, 30],
      [39, 21], [43, 13], [52, 16], [59, 22], [56, 26], [50, 29], [57, 26], [66, 25], [72, 20], [77, 8], [80, 14],
      [88, 22], [94, 17], [98, 9], [101, 3], [104, 2], [102, 12], [107, 10], [109, 13], [108, 20], [114, 22], [121, 28], [121, 37], [126, 34],
      [129, 37], [131, 43], [140, 50], [141, 54], [136, 55], [143, 59], [156, 61], [156, 51], [163, 58], [170, 62], [181, 65],
      [181, 69], [160, 70], [140, 73], [113, 74], [104, 77], [80, 73], [68, 69], [55, 69], [42, 67], [27, 71], [18, 69], [12, 65],
      [5, 61], [7, 58], [12, 58], [18, 62], [22, 65], [22, 60], [26, 59], [20, 55], [9, 56], [8, 54], [4, 52], [-2, 49], [-4, 48], [-1, 44]],
    // Great Britain, Ireland, Iceland.
    &[[-5, 50], [1, 51], [0, 54], [-3, 58], [-6, 57], [-4, 54]],
    &[[-10, 52], [-6, 52], [-6, 55], [-9, 54]],
    &[[-24, 65], [-15, 64], [-14, 66], [-22, 66]],
    // Japan, the Philippines, Sumatra, Java, Borneo, New Guinea.
    &[[130, 32], [136, 34], [141, 36], [142, 42], [145, 44], [140, 41], [137, 37], [132, 35]],
    &[[119, 18], [122, 18], [126, 7], [122, 9]],
    &[[95, 6], [104, -2], [106, -6], [101, -3]],
    &[[105, -6], [114, -7], [114, -9], [107, -8]],
    &[[109, 1], [115, 5], [119, 5], [117, -3], [111, -3]],
    &[[131, -1], [141, -3], [150, -10], [143, -9], [138, -8]],
    // Australia, New Zealand, Madagascar.
    &[[114, -22], [122, -18], [130, -12], [136, -12], [140, -17], [142, -11], [146, -19], [153, -26], [150, -37], [144, -39], [137, -35],
      [131, -32], [124, -33], [116, -35]],
    &[[167, -46], [171, -43], [174, -40], [174, -36], [178, -38], [172, -45]],
    &[[44, -25], [47, -25], [50, -15], [48, -13], [44, -18]],
    // Antarctica.
    &[[-181, -78], [-120, -74], [-75, -73], [-60, -64], [-58, -75], [-30, -77], [0, -70], [40, -69], [90, -66], [140, -67], [170, -72],
      [181, -78], [181, -91], [-181, -91]],
];
