//! A flight as the Web API starts it.

use serde_json::{Value, json};

/// A start in the air, in rain under one cloud.
pub fn web_flight() -> Value {
    json!({ "data": {
        "aircraft": { "path": "Aircraft/Laminar Research/Boeing 737-800/b738.acf" },
        "lle_air_start": {
            "latitude": 1.2, "longitude": 103.9, "elevation_in_meters": 762.001, "heading_true": 23.02,
            "speed_in_meters_per_second": 80.001, "pitch_in_degrees": 2.5,
        },
        "gmt_time": { "day_of_year": 79, "time_in_24_hours": 22.5 },
        "weather": {
            "definition": {
                "latitude_in_degrees": 1.2, "longitude_in_degrees": 103.9, "elevation_in_meters": 0.001,
                "visibility_in_kilometers": 8.04672, "altimeter_setting_in_hpa": 1009.5, "precipitation_ratio": 0.5,
                "clouds": [{
                    "type": "cumulunimbus", "cover_ratio": 0.75, "bases_in_feet_msl": 2000.001, "tops_in_feet_msl": 30000.001,
                }],
                "wind": [{ "altitude_in_feet_msl": 0.001, "speed_in_knots": 10.001, "direction_in_degrees_true": 340.001 }],
            },
            "vertical_speed_in_thermal_in_feet_per_minute": 0.001, "wave_height_in_meters": 0.5,
            "wave_direction_in_degrees": 270.001, "terrain_state": "dry",
            "variation_across_region_percentage": 0.001, "evolution_over_time_enum": "static",
        },
    }})
}
