//! The written model simulates as the one that was found.

use std::path::Path;

use sagci_model::{EffectEntry, ObjectModel};

#[test]
fn the_written_model_predicts_what_the_found_one_does() {
    let measured = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured/uw_pendulum");
    let mut model = ObjectModel::read(&measured).unwrap_or_else(|e| panic!("{e}"));
    for (effect, parameter, value) in [("viscous_friction", "damping", 1e-4 / 3.0), ("coulomb_friction", "friction", 2e-4 / 7.0)] {
        let parameters = [(parameter.to_owned(), value)].into();
        model.document.effects.push(EffectEntry {
            effect: effect.into(),
            joint: Some("pivot".into()),
            parameters,
            ..EffectEntry::default()
        });
    }
    let logs = sagci_recording::read(&[measured.join("swing_1.csv")], Some(&model)).unwrap_or_else(|e| panic!("{e}"));
    let unmarked = crate::predict(&model, &logs, 1.0).unwrap_or_else(|e| panic!("{e}")).table;
    model.state_in_urdf();
    let found = crate::predict(&model, &logs, 1.0).unwrap_or_else(|e| panic!("{e}")).table;
    assert!(found == unmarked, "marking an effect changed what is simulated");

    let folder = std::env::temp_dir().join(format!("sagci-gap-round-trip-{}", std::process::id()));
    model.write_as(&folder, "model.urdf").unwrap_or_else(|e| panic!("{e}"));
    let written = ObjectModel::read_urdf(folder.join("model.urdf"));
    let urdf = std::fs::read_to_string(folder.join("model.urdf")).unwrap_or_default();
    let _ = std::fs::remove_dir_all(&folder);
    assert!(urdf.contains("<dynamics damping=\"0.0000333"), "{urdf}");
    let again = crate::predict(&written.unwrap_or_else(|e| panic!("{e}")), &logs, 1.0).unwrap_or_else(|e| panic!("{e}")).table;
    // The URDF's angles are rounded once; nothing else may differ.
    let numbers = |text: &str| -> Vec<f64> { text.lines().skip(1).flat_map(|l| l.split(',').map(|c| c.parse().unwrap_or(0.0))).collect() };
    let (a, b) = (numbers(&found), numbers(&again));
    assert_eq!(a.len(), b.len());
    let most = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(most < 1e-9, "predictions differ by {most:e}");
}
