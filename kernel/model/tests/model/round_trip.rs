//! What is written reads back as the same model.
use std::path::Path;

use nalgebra::Isometry3;
use sagci_model::{Geometry, ObjectModel, Shape, TriangleMesh};

fn shipped() -> Vec<ObjectModel> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models");
    let mut models = Vec::new();
    for entry in std::fs::read_dir(root).unwrap() {
        let home = entry.unwrap().path();
        if let Ok(head) = std::fs::read_to_string(home.join("HEAD")) {
            models.push(ObjectModel::read(home.join(head.trim())).unwrap());
        }
    }
    assert!(models.len() >= 5);
    models
}

fn assert_near(a: &Isometry3<f64>, b: &Isometry3<f64>, what: &str) {
    let off = (a.translation.vector - b.translation.vector).norm() + a.rotation.angle_to(&b.rotation);
    assert!(off < 1e-14, "{what}: off by {off:e}");
}

fn assert_same_shape(a: &Shape, b: &Shape, what: &str) {
    assert_eq!((&a.name, a.rgba), (&b.name, b.rgba), "{what}");
    assert_near(&a.X_LG, &b.X_LG, what);
    match (&a.geometry, &b.geometry) {
        (Geometry::Mesh { mesh: m, scale: s, .. }, Geometry::Mesh { mesh: n, scale: t, .. }) => assert!(m == n && s == t, "{what}"),
        (g, h) => assert_eq!(format!("{g:?}"), format!("{h:?}"), "{what}"),
    }
}

fn assert_same(a: &ObjectModel, b: &ObjectModel) {
    assert_eq!(a.name, b.name);
    assert_eq!(a.document, b.document);
    assert_eq!((a.links.len(), a.joints.len()), (b.links.len(), b.joints.len()));
    for (l, m) in a.links.iter().zip(&b.links) {
        assert_eq!((&l.name, l.inertial), (&m.name, m.inertial));
        assert_eq!((l.visuals.len(), l.collisions.len()), (m.visuals.len(), m.collisions.len()), "{}", l.name);
        for (s, t) in l.visuals.iter().chain(&l.collisions).zip(m.visuals.iter().chain(&m.collisions)) {
            assert_same_shape(s, t, &l.name);
        }
    }
    for (i, j) in a.joints.iter().zip(&b.joints) {
        assert_eq!((&i.name, i.kind, i.parent, i.child), (&j.name, j.kind, j.parent, j.child));
        assert_eq!((i.limits, i.damping, i.friction, i.mimic), (j.limits, j.damping, j.friction, j.mimic), "{}", i.name);
        assert!((i.axis.into_inner() - j.axis.into_inner()).norm() < 1e-15, "{}", i.name);
        assert_near(&i.X_PJ, &j.X_PJ, &i.name);
    }
}

#[test]
fn a_shipped_model_reads_back_as_it_was_written() {
    for model in shipped() {
        let folder = tempfile::tempdir().unwrap();
        model.write(folder.path()).unwrap();
        assert_same(&model, &ObjectModel::read(folder.path()).unwrap());
    }
}

/// Everything that a URDF can say, at once: every joint type, mimics of mimics, scaled and mirrored meshes from
/// elsewhere, names that need escaping, inertia in turned axes.
#[test]
fn an_odd_model_reads_back_as_it_was_written() {
    let elsewhere = tempfile::tempdir().unwrap();
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(elsewhere.path().join("part.obj"), tetrahedron).unwrap();
    let mesh = elsewhere.path().join("part.obj");
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"0.1 -0.2 0.3\" rpy=\"0.4 0.5 -2\"/><mass value=\"1.5\"/>\
             <inertia ixx=\"0.1\" ixy=\"0.01\" ixz=\"0\" iyy=\"0.12\" iyz=\"-0.02\" izz=\"0.15\"/></inertial>\
             <visual name=\"a &lt;b&gt; &amp; &quot;c&quot;\"><origin rpy=\"0 1.5707963267948966 0.3\"/><geometry><mesh \
             filename=\"file://{}\" scale=\"0.5 -0.25 0.125\"/></geometry><material name=\"shared\"/></visual>\
             <collision><geometry><cylinder radius=\"0.1\" length=\"0.3\"/></geometry></collision></link>",
            mesh.display()
        )
    };
    let joint = |i: usize, kind: &str, rest: &str| {
        format!(
            "<joint name=\"j{i}\" type=\"{kind}\"><origin xyz=\"0.1 0.2 {i}\" rpy=\"1 -1.2 3\"/><parent link=\"l{}\"/>\
             <child link=\"l{i}\"/><axis xyz=\"1 2 -2\"/>{rest}</joint>",
            i - 1
        )
    };
    let limit = "<limit lower=\"-0.1\" upper=\"0.7\" velocity=\"3\" effort=\"0.3\"/>";
    let mimic = |j: usize, m: f64| format!("{limit}<mimic joint=\"j{j}\" multiplier=\"{m}\" offset=\"0.5\"/>");
    let parts = [
        "<material name=\"shared\"><color rgba=\"0.1 0.2 0.3 0.4\"/></material>".to_owned(),
        (0..=7).map(|i| link(&format!("l{i}"))).collect(),
        joint(1, "revolute", &format!("{limit}<dynamics damping=\"0.125\" friction=\"3\"/>")),
        joint(2, "prismatic", &mimic(1, -2.0)),
        joint(3, "continuous", ""),
        joint(4, "floating", ""),
        joint(5, "planar", ""),
        joint(6, "fixed", ""),
        joint(7, "revolute", &mimic(2, 3.0)),
    ];
    let source = tempfile::tempdir().unwrap();
    std::fs::write(source.path().join("object.urdf"), format!("<robot name=\"odd\">{}</robot>", parts.concat())).unwrap();
    let model = ObjectModel::read(source.path()).unwrap();
    let last = model.joints[6].mimic.unwrap();
    // q7 = 3 (-2 q1 + 0.5) + 0.5
    assert_eq!((last.joint, last.multiplier, last.offset), (0, -6.0, 2.0));
    assert_eq!(model.links[3].visuals[0].rgba, Some([0.1, 0.2, 0.3, 0.4]));
    let Geometry::Mesh { mesh: read, .. } = &model.links[0].visuals[0].geometry else { panic!() };
    assert!((read.volume() - 0.5 * 0.25 * 0.125 / 6.0).abs() < 1e-15, "a mirrored mesh keeps its outside outside");

    let target = tempfile::tempdir().unwrap();
    model.write(target.path()).unwrap();
    drop(elsewhere);
    assert_same(&model, &ObjectModel::read(target.path()).unwrap());

    // Once the sources are gone, the meshes are written from their triangles: single precision, and exact for these.
    drop(source);
    let again = tempfile::tempdir().unwrap();
    model.write(again.path()).unwrap();
    let mut copy = ObjectModel::read(again.path()).unwrap();
    for (l, m) in copy.links.iter_mut().zip(&model.links) {
        for (s, t) in l.visuals.iter_mut().zip(&m.visuals) {
            let (Geometry::Mesh { mesh: n, .. }, Geometry::Mesh { mesh: m, .. }) = (&s.geometry, &t.geometry) else { continue };
            assert!(n.is_closed() && (n.volume() - m.volume()).abs() < 1e-9);
            s.geometry = t.geometry.clone();
        }
    }
    assert_same(&model, &copy);
}

#[test]
fn a_package_is_found_around_the_urdf() {
    let root = tempfile::tempdir().unwrap();
    let package = root.path().join("furniture");
    std::fs::create_dir_all(package.join("urdf")).unwrap();
    std::fs::create_dir_all(package.join("meshes")).unwrap();
    std::fs::write(package.join("meshes/part.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let urdf = "<robot name=\"r\"><link name=\"l\"><visual><geometry><mesh \
        filename=\"package://furniture/meshes/part.obj\"/></geometry></visual></link></robot>";
    std::fs::write(package.join("urdf/object.urdf"), urdf).unwrap();
    // A flat mesh is good enough to be seen.
    assert_eq!(ObjectModel::read(package.join("urdf")).unwrap().links[0].visuals.len(), 1);
}

#[test]
fn an_stl_reads_back_as_it_was_written_in_both_forms() {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/microwave");
    let head = std::fs::read_to_string(root.join("HEAD")).unwrap();
    let mesh = TriangleMesh::read(&root.join(head.trim()).join("meshes/microdoor.stl")).unwrap();
    let binary = folder.path().join("binary.stl");
    std::fs::write(&binary, mesh.to_stl()).unwrap();
    assert_eq!(TriangleMesh::read(&binary).unwrap(), mesh);

    let mut text = String::from("solid door\n");
    for t in &mesh.triangles {
        text += "facet normal 0 0 0\n outer loop\n";
        for &i in t {
            let v = mesh.vertices[i as usize];
            text += &format!("  vertex {:e} {:e} {:e}\n", v.x, v.y, v.z);
        }
        text += " endloop\nendfacet\n";
    }
    let ascii = folder.path().join("ascii.stl");
    std::fs::write(&ascii, text + "endsolid door\n").unwrap();
    assert_eq!(TriangleMesh::read(&ascii).unwrap(), mesh);
    assert!(mesh.is_closed() && mesh.volume() > 0.0);
}

#[test]
fn an_effect_keeps_its_numbers_and_its_choices() {
    let yaml = "schema: 1\neffects:\n- effect: magnetic_gasket\n  joint: hinge\n  parameters: {force: 12.0, width: 0.01}\n  choices: {shape: inverse_square}\n\
                - effect: torque_bias\n  joint: hinge\n  parameters: {bias: 0.5}\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.yaml");
    std::fs::write(&path, yaml).unwrap();
    let document = sagci_model::Document::read(&path).unwrap();
    assert_eq!(document.effects[0].choices["shape"], "inverse_square");
    let written = document.to_yaml().unwrap();
    assert_eq!(written.matches("choices").count(), 1, "what was not chosen is not written: {written}");
    std::fs::write(&path, written).unwrap();
    assert_eq!(sagci_model::Document::read(&path).unwrap(), document);
}

#[test]
fn friction_that_urdf_can_say_stands_in_both_files_and_counts_once() {
    let text = r#"<robot name="door"><link name="frame"/><link name="leaf"><inertial><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/><dynamics friction="0.4"/></joint>
        <joint name="flap" type="continuous"><parent link="leaf"/><child link="flap_leaf"/><axis xyz="0 0 1"/></joint>
        <link name="flap_leaf"/></robot>"#;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("object.urdf"), text).unwrap();
    let mut model = ObjectModel::read(folder.path()).unwrap();
    let mut add = |effect: &str, joint: &str, parameter: &str, value: f64| {
        let parameters = [(parameter.to_owned(), value)].into();
        let joint = Some(joint.to_owned());
        model.document.effects.push(sagci_model::EffectEntry { effect: effect.into(), joint, parameters, ..Default::default() });
    };
    add("viscous_friction", "hinge", "damping", 0.1 + 0.2);
    // The URDF has a number of its own here: a second one would have to be told from it.
    add("coulomb_friction", "hinge", "friction", 0.7);
    add("coulomb_friction", "flap", "friction", 1.0 / 3.0);
    add("joint_spring", "flap", "stiffness", 2.0);
    model.state_in_urdf();
    assert_eq!(model.document.effects.iter().map(|e| e.in_urdf).collect::<Vec<_>>(), [true, false, true, false]);

    let out = folder.path().join("out");
    model.write(&out).unwrap();
    let urdf = std::fs::read_to_string(out.join("object.urdf")).unwrap();
    assert!(urdf.contains(&format!("<dynamics damping=\"{}\" friction=\"0.4\"/>", 0.1 + 0.2)), "{urdf}");
    assert!(urdf.contains(&format!("<dynamics damping=\"0\" friction=\"{}\"/>", 1.0 / 3.0)), "{urdf}");
    // In memory each number is there once.
    let again = ObjectModel::read(&out).unwrap();
    assert_same(&model, &again);
    assert_eq!((again.joints[0].damping, again.joints[0].friction, again.joints[1].friction), (0.0, 0.4, 0.0));

    // One of the two was changed: nobody can say which one holds.
    let refused = |urdf: &str, yaml: &str, words: &[&str]| {
        std::fs::write(out.join("object.urdf"), urdf).unwrap();
        std::fs::write(out.join("model.yaml"), yaml).unwrap();
        let error = ObjectModel::read(&out).unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    };
    let yaml = std::fs::read_to_string(out.join("model.yaml")).unwrap();
    refused(&urdf.replace("damping=\"0.3", "damping=\"0.5"), &yaml, &["hinge", "make them equal"]);
    refused(&urdf, &yaml.replace("effect: joint_spring", "in_urdf: true\n  effect: joint_spring"), &["joint_spring", "can only say"]);
}
