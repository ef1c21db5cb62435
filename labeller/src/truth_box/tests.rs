use airframe::{Configuration, Material, Triangle, boeing_737_800};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::geodesy::Geodetic;
use testkit::{approach, rig};

use super::*;

const GROUND_MSL_M: f64 = 6.71;

fn project(mesh: &Mesh, pose: &Pose, camera: &Camera, ground_msl_m: f64) -> Option<Projection> {
    Sighting::of(mesh, pose, camera, ground_msl_m).map(|seen| seen.projection)
}

/// A camera 10 m over the ground that looks along `heading_true_deg`, level, with a focal length of 1000 px.
fn level_camera(heading_true_deg: f64) -> (CameraPose, Camera) {
    let placed = CameraPose {
        pose: Pose {
            latitude_deg: 1.36,
            longitude_deg: 103.98,
            altitude_msl_m: GROUND_MSL_M + 10.0,
            heading_true_deg,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        },
        hfov_deg: 2.0 * (960.0_f64 / 1_000.0).atan().to_degrees(),
    };
    (placed, Camera::from_pose(&placed, 1920, 1280))
}

/// Pose of a body that flies towards the camera, at a place in the camera's body axes (forward, right, down).
fn facing(placed: &CameraPose, at_m: DVec3) -> Pose {
    let position = Geodetic::from_ecef(placed.pose.body_point_to_ecef(at_m));
    Pose {
        latitude_deg: position.latitude_deg,
        longitude_deg: position.longitude_deg,
        altitude_msl_m: position.altitude_msl_m,
        heading_true_deg: placed.pose.heading_true_deg + 180.0,
        pitch_deg: 0.0,
        roll_deg: 0.0,
    }
}

/// A flat rectangle across the body's x axis, from `low` to `high` in right and down, metres.
fn board(low: DVec2, high: DVec2) -> Mesh {
    let material = boeing_737_800(Configuration::default()).triangles[0].material;
    board_of(low, high, material)
}

fn board_of(low: DVec2, high: DVec2, material: Material) -> Mesh {
    let vertices = [
        (low.x, low.y),
        (high.x, low.y),
        (high.x, high.y),
        (low.x, high.y),
    ];
    Mesh {
        vertices: vertices
            .map(|(right, down)| DVec3::new(0.0, right, down))
            .to_vec(),
        triangles: [[0, 1, 2], [0, 2, 3]]
            .map(|indices| Triangle { indices, material })
            .to_vec(),
    }
}

#[test]
fn a_board_of_known_size_at_a_known_place_has_the_box_computed_by_hand() {
    let (placed, camera) = level_camera(0.0);
    // 20 m x 4 m at 1000 m, 50 m right of the axis and 30 m above: 1 px a metre about (959.5 + 50, 639.5 - 30).
    let pose = facing(&placed, DVec3::new(1_000.0, 50.0, -30.0));
    let mesh = board(DVec2::new(-10.0, -2.0), DVec2::new(10.0, 2.0));
    let seen = project(&mesh, &pose, &camera, GROUND_MSL_M).unwrap();
    // The verticals of camera and body differ by 1 km / Earth's radius: 0.16 mrad, below a hundredth of a pixel here.
    assert!((seen.pixel_box.cx_px - 1_009.5).abs() < 0.01, "{seen:?}");
    assert!((seen.pixel_box.cy_px - 609.5).abs() < 0.01, "{seen:?}");
    assert!((seen.pixel_box.width_px - 20.0).abs() < 0.02, "{seen:?}");
    assert!((seen.pixel_box.height_px - 4.0).abs() < 0.02, "{seen:?}");
    assert_eq!((seen.visible_fraction, seen.truncation), (1.0, 0.0));
    assert!((seen.range_m - 1_001.7).abs() < 0.1, "{seen:?}");
}

#[test]
fn a_board_across_the_right_edge_is_clipped_to_the_picture() {
    let (placed, camera) = level_camera(90.0);
    // The right edge of the image, 1919.5, lies 960 m right of the axis at 1000 m: 5 m of the board's 20 m are inside.
    let pose = facing(&placed, DVec3::new(1_000.0, 965.0, -30.0));
    let mesh = board(DVec2::new(-10.0, -2.0), DVec2::new(10.0, 2.0));
    let seen = project(&mesh, &pose, &camera, GROUND_MSL_M).unwrap();
    let [left, _, right, _] = seen.pixel_box.edges();
    assert!(
        (left - 1_914.5).abs() < 0.02 && right == 1_919.5,
        "{seen:?}"
    );
    assert!((seen.truncation - 0.75).abs() < 0.002, "{seen:?}");
    assert!((seen.visible_fraction - 0.25).abs() < 0.005, "{seen:?}");
}

#[test]
fn what_is_outside_behind_or_below_ground_has_no_box() {
    let (placed, camera) = level_camera(90.0);
    let mesh = board(DVec2::new(-10.0, -2.0), DVec2::new(10.0, 2.0));
    for at in [
        DVec3::new(1_000.0, 1_000.0, 0.0),
        DVec3::new(-1_000.0, 0.0, 0.0),
        DVec3::new(1_000.0, 0.0, 20.0),
    ] {
        assert_eq!(
            project(&mesh, &facing(&placed, at), &camera, GROUND_MSL_M),
            None,
            "{at}"
        );
    }
}

#[test]
fn a_board_half_sunk_into_the_ground_is_half_visible() {
    let (placed, camera) = level_camera(90.0);
    let mesh = board(DVec2::new(-10.0, -2.0), DVec2::new(10.0, 2.0));
    let mut pose = facing(&placed, DVec3::new(1_000.0, 0.0, 0.0));
    pose.altitude_msl_m = GROUND_MSL_M;
    let seen = project(&mesh, &pose, &camera, GROUND_MSL_M).unwrap();
    assert!((seen.visible_fraction - 0.5).abs() < 0.01, "{seen:?}");
    assert_eq!(seen.truncation, 0.0);
    assert!(
        (seen.pixel_box.height_px - 4.0).abs() < 0.02,
        "the box keeps the hidden part: {seen:?}"
    );
}

#[test]
fn a_mesh_that_reaches_behind_the_camera_is_cut_before_it() {
    let (placed, camera) = level_camera(0.0);
    let mesh = boeing_737_800(Configuration::default());
    // The nose is 18 m ahead of the centre of gravity and passes 3 m above the camera's right side.
    let seen = project(
        &mesh,
        &facing(&placed, DVec3::new(10.0, 6.0, -6.0)),
        &camera,
        GROUND_MSL_M,
    )
    .unwrap();
    assert!(seen.truncation > 0.5 && seen.truncation <= 1.0, "{seen:?}");
    assert!(
        seen.visible_fraction > 0.0 && seen.visible_fraction < 1.0,
        "{seen:?}"
    );
    let [left, top, right, bottom] = seen.pixel_box.edges();
    assert!(
        left >= -0.5 && top >= -0.5 && right <= 1_919.5 && bottom <= 1_279.5,
        "{seen:?}"
    );
}

#[test]
fn the_truth_box_is_the_box_of_a_silhouette_cast_ray_by_ray() {
    let mesh = boeing_737_800(Configuration {
        flap_ratio: 0.75,
        gear_ratio: 1.0,
    });
    const RAYS_PER_PIXEL: i32 = 10;
    for (view, along_track_m) in [("left", 16_000.0), ("right", 12_000.0)] {
        let camera = Camera::from_pose(&rig::placed(view), 1920, 1280);
        let mut pose = approach::on_glide_path(along_track_m, 12.0);
        pose.roll_deg = 4.0;
        let seen = project(&mesh, &pose, &camera, GROUND_MSL_M).unwrap();
        let [left, top, right, bottom] = seen.pixel_box.edges();
        let step = 1.0 / f64::from(RAYS_PER_PIXEL);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (columns, rows) = (
            ((right - left + 2.0) / step) as i32,
            ((bottom - top + 2.0) / step) as i32,
        );
        let in_body = pose.ecef_from_body().transpose();
        let origin = in_body * (camera.center_ecef_m - pose.position().to_ecef());
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)))
        {
            let pixel = DVec2::new(left - 1.0, top - 1.0)
                + DVec2::new(f64::from(column), f64::from(row)) * step;
            // Only the outermost hits count.
            let inside = (pixel.x - left).min(right - pixel.x);
            if inside.min(pixel.y - top).min(bottom - pixel.y) > 0.5 {
                continue;
            }
            let ray = in_body * camera.ray(pixel);
            if mesh
                .triangles
                .iter()
                .any(|triangle| meets(origin, ray, mesh.corners(triangle)))
            {
                (low, high) = (low.min(pixel), high.max(pixel));
            }
        }
        // Rays miss parts thinner than their spacing: wing tips and the fin's tip.
        for (cast, edge) in [
            (low.x, left),
            (low.y, top),
            (high.x, right),
            (high.y, bottom),
        ] {
            assert!(
                (cast - edge).abs() < 0.12,
                "{view}: rays give {low} to {high}, the box is {seen:?}"
            );
        }
    }
}

/// Moeller and Trumbore (1997).
fn meets(origin: DVec3, ray: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let (edge_b, edge_c) = (b - a, c - a);
    let p = ray.cross(edge_c);
    let determinant = edge_b.dot(p);
    if determinant.abs() < 1e-14 {
        return false;
    }
    let to_origin = origin - a;
    let u = to_origin.dot(p) / determinant;
    let q = to_origin.cross(edge_b);
    let v = ray.dot(q) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && edge_c.dot(q) / determinant > 0.0
}

#[test]
fn the_default_rig_sees_the_aircraft_as_large_as_the_geometry_says() {
    // B737-800 seen with a field of view of 10 degrees: 41 x 14 px at 5 NM, 21 x 7 px at 10 NM.
    let mesh = boeing_737_800(Configuration {
        flap_ratio: 0.75,
        gear_ratio: 1.0,
    });
    for (range_nm, width_px) in [(5.0, 41.0), (10.0, 21.0)] {
        let pose = approach::on_glide_path(range_nm * 1_852.0 - 1_500.0, 0.0);
        let camera = Camera::from_pose(&rig::placed("left"), 1920, 1280);
        let seen = project(&mesh, &pose, &camera, GROUND_MSL_M).unwrap();
        assert!((seen.pixel_box.width_px - width_px).abs() < 1.5, "{seen:?}");
        assert!(seen.visible_fraction == 1.0, "{seen:?}");
    }
}

#[test]
fn a_whole_aircraft_is_cut_off_by_exactly_nothing() {
    let (placed, camera) = level_camera(17.0);
    let mesh = boeing_737_800(Configuration::default());
    let mut whole = 0;
    for step in 0..200 {
        let t = f64::from(step);
        let at_m = DVec3::new(150.0 + 37.3 * t, 0.31 * t - 20.0, -30.7 - 0.17 * t);
        let seen = project(&mesh, &facing(&placed, at_m), &camera, GROUND_MSL_M).unwrap();
        let half = DVec2::new(seen.pixel_box.width_px, seen.pixel_box.height_px) / 2.0;
        let centre = DVec2::new(seen.pixel_box.cx_px, seen.pixel_box.cy_px);
        let (low, high) = (centre - half, centre + half);
        if low.min_element() > 1.0 && high.x < 1919.0 && high.y < 1279.0 {
            whole += 1;
            assert_eq!(seen.truncation, 0.0, "at {at_m} m");
        }
    }
    assert!(whole > 100, "{whole} whole ones");
}

#[test]
fn a_board_behind_a_post_is_hidden_as_far_as_computed_by_hand_and_the_post_is_not() {
    let (placed, camera) = level_camera(0.0);
    // 20 px wide and 4 px high; a post of half the distance on the same ray covers 4 px of the width and all of the height.
    let far = facing(&placed, DVec3::new(1_000.0, 50.0, -30.0));
    let near = facing(&placed, DVec3::new(500.0, 25.0, -15.0));
    let wide = board(DVec2::new(-10.0, -2.0), DVec2::new(10.0, 2.0));
    let post = board(DVec2::new(-1.0, -5.0), DVec2::new(1.0, 5.0));
    let sighting = |mesh, pose| Sighting::of(mesh, pose, &camera, GROUND_MSL_M);
    let all = [
        sighting(&wide, &far),
        sighting(&post, &near),
        sighting(&post, &near),
    ];
    let hidden = |at: usize| all[at].as_ref().unwrap().occluded_fraction(&all, &camera);
    assert!((hidden(0) - 0.2).abs() < 0.005, "{}", hidden(0));
    assert_eq!((hidden(1), hidden(2)), (0.0, 0.0));
    let beside = facing(&placed, DVec3::new(500.0, 32.0, -15.0));
    let apart = [sighting(&wide, &far), sighting(&post, &beside)];
    let first = apart[0].as_ref().unwrap();
    assert_eq!(first.occluded_fraction(&apart, &camera), 0.0);
}
