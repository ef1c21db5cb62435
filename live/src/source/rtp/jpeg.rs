//! JPEG images from RTP packets (RFC 2435), which leave out the headers. Their Huffman tables are those that decoders assume.

/// Quantisation tables for a quality of 50, in zigzag order (ISO/IEC 10918-1, annex K).
const LUMA: [u8; 64] = [
    16, 11, 12, 14, 12, 10, 16, 14, 13, 14, 18, 17, 16, 19, 24, 40, 26, 24, 22, 22, 24, 49, 35, 37,
    29, 40, 58, 51, 61, 60, 57, 51, 56, 55, 64, 72, 92, 78, 64, 68, 87, 69, 55, 56, 80, 109, 81,
    87, 95, 98, 103, 104, 103, 62, 77, 113, 121, 112, 100, 120, 92, 101, 103, 99,
];
const CHROMA: [u8; 64] = [
    17, 18, 18, 24, 21, 24, 47, 26, 26, 47, 99, 66, 56, 66, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
];

/// Adds a payload to an image, whose header the first one determines; `None` if it is not intact, or not the next.
pub(super) fn add(data: &mut Vec<u8>, payload: &[u8]) -> Option<()> {
    let (head, mut rest) = payload.split_first_chunk::<8>()?;
    let [_, _, _, _, kind, quality, width, height] = *head;
    let is_first = head[1..4] == [0; 3];
    let mut restart = [0; 2];
    if kind & 0x40 != 0 {
        let (marker, after) = rest.split_first_chunk::<4>()?;
        (restart, rest) = ([marker[0], marker[1]], after);
    }
    if is_first {
        data.clear();
        let tables = if quality >= 128 {
            let (head, after) = rest.split_first_chunk::<4>()?;
            let length = u16::from_be_bytes([head[2], head[3]]);
            let (tables, after) = after.split_at_checked(length.into())?;
            rest = after;
            tables.to_vec()
        } else {
            let of = [LUMA, CHROMA].concat().into_iter();
            of.map(|value| scaled(value, quality)).collect()
        };
        let sides = [width, height].map(|side| (8 * u16::from(side)).to_be_bytes());
        add_header(data, kind & 0x3f, sides, restart, &tables)?;
    } else if data.is_empty() {
        return None;
    }
    data.extend(rest);
    Some(())
}

fn scaled(value: u8, quality: u8) -> u8 {
    let quality = u32::from(quality.clamp(1, 99));
    let percent = if quality < 50 {
        5_000 / quality
    } else {
        200 - 2 * quality
    };
    ((u32::from(value) * percent + 50) / 100).clamp(1, 255) as u8
}

fn add_header(
    data: &mut Vec<u8>,
    kind: u8,
    sides: [[u8; 2]; 2],
    restart: [u8; 2],
    tables: &[u8],
) -> Option<()> {
    let [[width, width_low], [height, height_low]] = sides;
    if kind > 1 || tables.len() != 128 {
        return None;
    }
    data.extend([0xff, 0xd8]);
    for (number, table) in tables.chunks(64).enumerate() {
        data.extend([0xff, 0xdb, 0, 67, number as u8]);
        data.extend(table);
    }
    if restart != [0; 2] {
        data.extend([0xff, 0xdd, 0, 4, restart[0], restart[1]]);
    }
    let sampling = if kind == 0 { 0x21 } else { 0x22 };
    data.extend([
        0xff, 0xc0, 0, 17, 8, height, height_low, width, width_low, 3,
    ]);
    data.extend([1, sampling, 0, 2, 0x11, 1, 3, 0x11, 1]);
    data.extend([0xff, 0xda, 0, 12, 3, 1, 0, 2, 0x11, 3, 0x11, 0, 63, 0]);
    Some(())
}
