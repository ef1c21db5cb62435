pub(crate) mod blob_finder;

use dataset::tables::pixel_box::PixelBox;

use super::*;
use blob_finder::{BlobFinder, paint_blob};

const WIDTH: u32 = 1920;
const HEIGHT: u32 = 1280;

fn find(width_px: u32, height_px: u32, blobs: &[PixelBox]) -> (Vec<Sighting>, BlobFinder) {
    let mut rgb = vec![0; (width_px * height_px * 3) as usize];
    for blob in blobs {
        paint_blob(&mut rgb, width_px, blob);
    }
    let mut finder = BlobFinder::default();
    let picture = PictureView {
        rgb: &rgb,
        width_px,
        height_px,
    };
    let found = find_aircraft(&mut finder, &picture, &TilingSettings::default()).unwrap();
    (found, finder)
}

fn boxes_of(found: &[Sighting]) -> Vec<PixelBox> {
    found
        .iter()
        .map(|sighting| sighting.found.pixel_box)
        .collect()
}

/// A box of whole pixels, from its first to its last column and row.
fn pixels(columns: (u32, u32), rows: (u32, u32)) -> PixelBox {
    let edge = |pixel: u32, side: f64| f64::from(pixel) + side;
    PixelBox::from_edges(
        edge(columns.0, -0.5),
        edge(rows.0, -0.5),
        edge(columns.1, 0.5),
        edge(rows.1, 0.5),
    )
}

#[test]
fn coordinates_come_back_exactly_from_every_tile() {
    let places = [
        (20, 30),
        (700, 100),
        (1_900, 610),
        (5, 1_200),
        (1_000, 900),
        (1_910, 1_275),
    ];
    for (tile, (column, row)) in (0..).zip(places) {
        let blob = pixels((column, column + 6), (row, row + 2));
        let (found, _) = find(WIDTH, HEIGHT, &[blob]);
        assert_eq!(boxes_of(&found), [blob]);
        assert_eq!((found[0].found.score, found[0].tile), (1.0, tile));
    }
}

#[test]
fn an_aircraft_across_four_tiles_is_found_whole_by_the_second_pass_and_once() {
    let blob = pixels((630, 655), (636, 645));
    let (found, finder) = find(WIDTH, HEIGHT, &[blob]);
    assert_eq!(boxes_of(&found), [blob]);
    assert_eq!(finder.windows_seen, 6 + 4, "four tiles show a part each");
}

#[test]
fn several_aircraft_get_a_window_each() {
    let blobs = [
        pixels((100, 120), (100, 106)),
        pixels((1_500, 1_507), (1_000, 1_002)),
    ];
    let (found, _) = find(WIDTH, HEIGHT, &blobs);
    let mut boxes = boxes_of(&found);
    boxes.sort_by(|a, b| a.cx_px.total_cmp(&b.cx_px));
    assert_eq!(boxes, blobs);
}

#[test]
fn pictures_that_are_no_multiple_of_a_tile_or_smaller_than_one_work_too() {
    for (width, height, blob) in [
        (1_920, 1_080, pixels((1_000, 1_008), (1_070, 1_079))),
        (300, 200, pixels((290, 299), (3, 5))),
    ] {
        let (found, _) = find(width, height, &[blob]);
        assert_eq!(boxes_of(&found), [blob]);
    }
}

#[test]
fn an_empty_picture_has_no_aircraft_and_no_second_pass() {
    let (found, finder) = find(WIDTH, HEIGHT, &[]);
    assert_eq!((found.len(), finder.windows_seen), (0, 6));
}

#[test]
fn a_finder_of_any_size_looks_at_the_whole_picture_and_once_more_at_each_hit() {
    let blob = pixels((630, 655), (636, 645));
    let mut rgb = vec![0; (WIDTH * HEIGHT * 3) as usize];
    paint_blob(&mut rgb, WIDTH, &blob);
    let picture = PictureView {
        rgb: &rgb,
        width_px: WIDTH,
        height_px: HEIGHT,
    };
    let mut finder = BlobFinder::of_any_size();
    let mut settings = TilingSettings::default();
    let find = |finder: &mut BlobFinder, settings: &TilingSettings| {
        finder.windows_seen = 0;
        find_aircraft(finder, &picture, settings)
    };
    let is_blob = |found: &[Sighting]| matches!(found, [only] if only.found.pixel_box == blob);
    assert!(is_blob(&find(&mut finder, &settings).unwrap()));
    assert_eq!(finder.windows_seen, 2);
    settings.rows = Some(RowBand {
        top_px: 700,
        bottom_px: 1_280,
    });
    let found = find(&mut finder, &settings).unwrap();
    assert_eq!(found, [], "the blob is above these rows");
    settings.half_scale_rows = Some(RowBand {
        top_px: 400,
        bottom_px: 800,
    });
    let found = find(&mut finder, &settings).unwrap();
    assert!(is_blob(&found) && found[0].tile == 1, "{found:?}");
    settings = TilingSettings::default();
    finder.first_pass_shrink = 2;
    assert!(is_blob(&find(&mut finder, &settings).unwrap()));
    assert_eq!(finder.windows_seen, 2);
    settings.rows = Some(RowBand {
        top_px: 1_280,
        bottom_px: 2_000,
    });
    let refused = find(&mut finder, &settings).unwrap_err();
    assert!(
        refused.to_string().contains("1280:2000") && refused.to_string().contains("below 1280"),
        "{refused}"
    );
}

#[test]
fn tiles_of_an_impossible_size_are_refused_by_name() {
    for side_px in [0, 63, 16_385] {
        let settings = TilingSettings {
            tile_px: Some(side_px),
            ..Default::default()
        };
        let said = settings.check().unwrap_err().to_string();
        let found = format!("--tile is {side_px}");
        assert!(said.contains(&found), "{said}");
    }
}
