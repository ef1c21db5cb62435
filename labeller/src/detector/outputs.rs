//! Finds the outputs with the boxes and their layout, from the names, types and shapes of actual outputs.
//!
//! Settings, metadata and shapes that contradict each other are an error, never a guess.

use super::layout::Layout;
use super::layout::boxes_and_scores::PairOutputs;
use super::layout::efficient_nms::{NmsOutputs, OutputForm};
use super::layout::meaning::KnownModel;
use crate::error::ModelFault;

/// Dimensions of the raw heads that some exporters of YOLOv5 and v7 leave as further outputs.
const HEAD_RANK: usize = 5;
/// Dimensions of masks.
const MASK_RANK: usize = 4;

/// The outputs with the boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BoxOutputs {
    /// The one with this index.
    One(usize),
    /// Four that belong together.
    EfficientNms(NmsOutputs),
    /// Two that belong together.
    BoxesAndScores(PairOutputs),
}

impl BoxOutputs {
    pub(super) fn of(
        outputs: &[OutputForm],
        model: &KnownModel<'_>,
        settings: &str,
    ) -> Result<(Self, Layout), ModelFault> {
        let (said, window_px) = (model.profile.layout, model.window_px);
        let has_objectness = !model.metadata.is_by_ultralytics();
        let named = model.metadata.named_classes();
        let named_output = model.profile.output.as_deref();
        if let Some(name) = named_output
            && outputs.iter().all(|output| output.name != name)
        {
            let names: Vec<&str> = outputs.iter().map(|output| output.name.as_str()).collect();
            return Err(ModelFault::new(format!(
                "its settings say output = {name:?}, but its outputs are {}",
                names.join(", ")
            )));
        }
        let is_said = |layout| said.is_none_or(|said| said == layout);
        let y_first = outputs.iter().find(|output| is_y_first(&output.name));
        if let Some(output) = y_first.filter(|_| said.is_none()) {
            return Err(ModelFault::new(format!(
                "its output {:?} has the name of TensorFlow's boxes, whose numbers begin with the top edge; export it with the left edge \
                 first, or name its layout in {settings} if it has that already",
                output.name
            )));
        }
        if said == Some(Layout::BoxesAndScores)
            && let Some(found) = PairOutputs::of(outputs, named_output)
        {
            return Ok((Self::BoxesAndScores(found), Layout::BoxesAndScores));
        }
        if is_said(Layout::EfficientNms)
            && let Some(found) = NmsOutputs::of(outputs)
        {
            match named_output {
                None => return Ok((Self::EfficientNms(found), Layout::EfficientNms)),
                Some(name) if said.is_some() => {
                    return Err(ModelFault::new(format!(
                        "its settings say output = {name:?}, but layout = \"efficient-nms\", which is read from four outputs; remove one of \
                         the two"
                    )));
                }
                // A different output is to be read.
                Some(_) => {}
            }
        }
        let layout_of = |output: &OutputForm| {
            let layout = match said {
                Some(Layout::EfficientNms | Layout::BoxesAndScores) => None,
                Some(said) => said.fits(&output.shape, window_px).then_some(said),
                None => Layout::of_shape(&output.shape, window_px, has_objectness, named),
            };
            layout
                .filter(|_| !output.holds_integers)
                .filter(|_| named_output.is_none_or(|name| output.name == name))
        };
        let found: Vec<_> = outputs
            .iter()
            .enumerate()
            .filter_map(|(index, output)| Some((index, layout_of(output)?)))
            .collect();
        // Masks or landmarks beside the boxes mean a different task; raw heads are the same boxes again.
        let is_other =
            |output: &OutputForm| output.shape.len() != HEAD_RANK && layout_of(output).is_none();
        match found[..] {
            [(index, layout)]
                if said.is_some() || named_output.is_some() || !outputs.iter().any(is_other) =>
            {
                Ok((Self::One(index), layout))
            }
            [(_, layout), _, ..] => {
                let names = found.iter().map(|&(index, _)| outputs[index].name.as_str());
                let names: Vec<&str> = names.collect();
                Err(ModelFault::new(format!(
                    "its outputs {} all have the layout {layout}, expected one; name one in its settings, e.g. output = {:?}, or export it \
                     without the others",
                    names.join(", "),
                    names[0]
                )))
            }
            _ => Err(ModelFault::new(match said {
                Some(said) => format!(
                    "its settings say layout = \"{said}\", which is {}, but no output is so for windows of {}x{} px",
                    said.shape(),
                    window_px[0],
                    window_px[1]
                ),
                None => format!(
                    "its outputs have none of the known layouts{}; name a layout in {}, or export the model with decoded boxes \
                     (docs/detectors.md)",
                    hint_of(outputs),
                    settings
                ),
            })),
        }
    }
}

/// Description of outputs that have no known layout.
fn hint_of(outputs: &[OutputForm]) -> &'static str {
    let ranks = || outputs.iter().map(|output| output.shape.len());
    match outputs {
        [output] if output.shape.len() == 2 => {
            ", but a single row of numbers, as from a classifier"
        }
        _ if outputs
            .iter()
            .any(|output| matches!(output.shape[..], [_, _, 1, 4])) =>
        {
            ", but boxes of the shape [batch, candidates, 1, 4], as pytorch-YOLOv4 exports them: leave the third dimension out (`Squeeze`), and \
             say layout = \"boxes-and-scores\""
        }
        _ if is_of_mmdeploy(outputs) => {
            ", but boxes with their scores, and labels, as mmdeploy exports them: export the model with easydeploy of MMYOLO instead, whose \
             outputs are num_dets, boxes, scores and labels"
        }
        _ if PairOutputs::of(outputs, None).is_some() => {
            ", but boxes and scores apart, which layout = \"boxes-and-scores\" reads"
        }
        _ if ranks().any(|rank| rank == HEAD_RANK) => ", but undecoded heads, one for each stride",
        _ if outputs.len() > 1 && ranks().any(|rank| rank == MASK_RANK) => {
            ", but masks or maps, as from a segmentation model"
        }
        _ => "",
    }
}

/// True for the names of boxes in TensorFlow's order: top, left, bottom, right.
fn is_y_first(name: &str) -> bool {
    let name = name.to_lowercase();
    name.contains("detection_boxes") || name.contains("yxyx")
}

/// True for edges and scores of final boxes with their classes.
fn is_of_mmdeploy(outputs: &[OutputForm]) -> bool {
    let has = |is_it: &dyn Fn(&OutputForm) -> bool| outputs.iter().any(is_it);
    has(&|output| matches!(output.shape[..], [_, _, 5]))
        && has(&|output| output.holds_integers && output.shape.len() == 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::profile::ModelProfile;
    use crate::detector::profile::metadata::ModelMetadata;

    fn form(name: &str, shape: &[usize]) -> OutputForm {
        OutputForm {
            name: name.into(),
            holds_integers: false,
            shape: shape.to_vec(),
        }
    }

    fn found(said: Option<Layout>, outputs: &[OutputForm]) -> Result<(BoxOutputs, Layout), String> {
        let profile = ModelProfile {
            layout: said,
            ..ModelProfile::default()
        };
        let model = KnownModel {
            window_px: [640, 640],
            profile: &profile,
            metadata: &ModelMetadata::default(),
        };
        BoxOutputs::of(outputs, &model, "net.onnx.toml").map_err(|fault| fault.to_string())
    }

    #[test]
    fn the_decoded_output_is_taken_and_raw_heads_beside_it_are_not() {
        let decoded = form("output", &[1, 25_200, 85]);
        let heads = [80, 40, 20].map(|side| form("head", &[1, 3, side, side, 85]));
        let all = [&heads[..1], std::slice::from_ref(&decoded), &heads[1..]].concat();
        assert_eq!(
            found(None, &all),
            Ok((BoxOutputs::One(1), Layout::AnchorRows))
        );
        let said = found(None, &heads).unwrap_err();
        assert!(
            said.contains("undecoded heads") && said.contains("net.onnx.toml"),
            "{said}"
        );
    }

    #[test]
    fn outputs_of_other_tasks_are_refused_with_what_they_look_like() {
        let columns = form("output0", &[1, 116, 8_400]);
        for (outputs, word) in [
            (
                vec![columns.clone(), form("output1", &[1, 32, 160, 160])],
                "segmentation",
            ),
            (vec![form("probabilities", &[1, 1_000])], "a classifier"),
            (
                vec![form("depth", &[1, 1, 640, 640])],
                "none of the known layouts",
            ),
            (
                vec![form("boxes", &[1, 900, 4]), form("logits", &[1, 900, 91])],
                "none of the known",
            ),
        ] {
            let said = found(None, &outputs).unwrap_err();
            assert!(said.contains(word), "{word} in {said}");
        }
    }

    #[test]
    fn boxes_with_the_top_edge_first_are_refused_by_their_name_unless_settings_say_their_layout() {
        let counts = OutputForm {
            holds_integers: true,
            ..form("num_detections", &[1, 1])
        };
        let rest = [
            ("detection_boxes", &[1, 100, 4][..]),
            ("detection_scores", &[1, 100]),
            ("detection_classes", &[1, 100]),
        ];
        let mut outputs = vec![counts];
        outputs.extend(rest.map(|(name, shape)| form(name, shape)));
        let said = found(None, &outputs).unwrap_err();
        assert!(said.contains("begin with the top edge"), "{said}");
        assert!(found(Some(Layout::EfficientNms), &outputs).is_ok());
        let yolo4 = [
            form("boxes", &[1, 22_743, 1, 4]),
            form("confs", &[1, 22_743, 80]),
        ];
        let said = found(None, &yolo4).unwrap_err();
        assert!(
            said.contains("pytorch-YOLOv4") && said.contains("Squeeze"),
            "{said}"
        );
    }

    #[test]
    fn of_two_outputs_with_four_numbers_the_one_with_detections_has_the_boxes() {
        let outputs = [form("dets", &[1, 300, 4]), form("labels", &[1, 300, 4])];
        let pair = PairOutputs {
            boxes: 0,
            scores: 1,
        };
        assert_eq!(
            found(Some(Layout::BoxesAndScores), &outputs),
            Ok((BoxOutputs::BoxesAndScores(pair), Layout::BoxesAndScores))
        );
    }

    #[test]
    fn settings_choose_among_outputs_and_must_fit_one() {
        let columns = form("boxes", &[1, 84, 8_400]);
        let other = form("features", &[1, 512]);
        let both = [columns.clone(), other];
        assert!(found(None, &both).is_err());
        assert_eq!(
            found(Some(Layout::Columns), &both),
            Ok((BoxOutputs::One(0), Layout::Columns))
        );
        for layout in [Layout::Yolox, Layout::BatchCorners, Layout::EfficientNms] {
            let said = found(Some(layout), std::slice::from_ref(&columns)).unwrap_err();
            for word in [layout.to_string().as_str(), layout.shape(), "640x640"] {
                assert!(said.contains(word), "{word} in {said}");
            }
        }
        for settings in [None, Some(Layout::Columns)] {
            let said = found(settings, &[columns.clone(), columns.clone()]);
            assert!(said.unwrap_err().contains("boxes, boxes"));
        }
    }
}
