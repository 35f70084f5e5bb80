//! The models that ship are read, and say what they should.
#![allow(clippy::unwrap_used)]

use sagci_model::ObjectModel;

#[test]
fn every_shipped_model_is_read() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models");
    for name in ["panda", "microwave", "drawer", "mug", "tape"] {
        let head = std::fs::read_to_string(root.join(name).join("HEAD")).unwrap();
        let model = ObjectModel::read(root.join(name).join(head.trim())).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(model.name, name);
    }
}
