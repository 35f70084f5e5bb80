//! The channels and what they hold. ROS 2 definitions are those of common_interfaces (sensor_msgs, geometry_msgs,
//! std_msgs) and rcl_interfaces (builtin_interfaces), fields only; foxglove.* follow the Foxglove SDK's JSON schemas.

use serde_json::{Value, json};

/// A channel.
pub(super) struct Channel {
    pub topic: &'static str,
    pub schema: &'static str,
    pub schema_encoding: &'static str,
    pub message_encoding: &'static str,
}

impl Channel {
    const fn ros(topic: &'static str, schema: &'static str) -> Self {
        Self { topic, schema, schema_encoding: "ros2msg", message_encoding: "cdr" }
    }

    const fn json(topic: &'static str, schema: &'static str) -> Self {
        Self { topic, schema, schema_encoding: "jsonschema", message_encoding: "json" }
    }
}

pub(super) const JOINT_STATES: usize = 0;
pub(super) const JOINT_COMMANDS: usize = 1;
pub(super) const WRENCH: usize = 2;
pub(super) const ROBOT_DESCRIPTION: usize = 3;
pub(super) const TF: usize = 4;
pub(super) const POINTS: usize = 5;
pub(super) const DEPTH: usize = 6;
pub(super) const LOG: usize = 7;
pub(super) const PHASE: usize = 8;
pub(super) const TRUTH: usize = 9;

/// All channels, in the order of the constants.
pub(super) const CHANNELS: [Channel; 10] = [
    Channel::ros("/joint_states", "sensor_msgs/msg/JointState"),
    Channel::ros("/joint_commands", "sensor_msgs/msg/JointState"),
    Channel::ros("/wrench", "geometry_msgs/msg/WrenchStamped"),
    Channel::ros("/robot_description", "std_msgs/msg/String"),
    Channel::json("/tf", "foxglove.FrameTransforms"),
    Channel::json("/camera/points", "foxglove.PointCloud"),
    Channel::json("/camera/depth", "foxglove.RawImage"),
    Channel::json("/log", "foxglove.Log"),
    Channel::json("/phase", "sagci.Phase"),
    Channel::ros("/truth", "sagci/msg/TrueFrame"),
];

const BAR: &str = "================================================================================\n";

/// The text of a schema.
pub(super) fn text(schema: &str) -> String {
    let header = format!(
        "{BAR}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{BAR}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    );
    match schema {
        "sensor_msgs/msg/JointState" => {
            format!("std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{header}")
        }
        "geometry_msgs/msg/WrenchStamped" => format!(
            "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n{header}{BAR}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\n\
             geometry_msgs/Vector3 torque\n{BAR}MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
        ),
        "std_msgs/msg/String" => "string data\n".to_owned(),
        "sagci/msg/TrueFrame" => format!(
            "# Poses of links (x y z, then qx qy qz qw) and states of joints (position, velocity); names in the channel's metadata.\n\
             std_msgs/Header header\nfloat64[] poses\nfloat64[] joints\n{header}"
        ),
        other => json_schema(other).to_string(),
    }
}

fn object(title: &str, properties: Value) -> Value {
    json!({ "title": title, "type": "object", "properties": properties })
}

fn json_schema(schema: &str) -> Value {
    let time = json!({ "type": "object", "title": "time", "properties": { "sec": { "type": "integer", "minimum": 0 }, "nsec": { "type": "integer", "minimum": 0, "maximum": 999_999_999 } } });
    let number = json!({ "type": "number" });
    let integer = json!({ "type": "integer" });
    let text = json!({ "type": "string" });
    let bytes = json!({ "type": "string", "contentEncoding": "base64" });
    let vector = object("foxglove.Vector3", json!({ "x": number, "y": number, "z": number }));
    let turn = object("foxglove.Quaternion", json!({ "x": number, "y": number, "z": number, "w": number }));
    match schema {
        "foxglove.FrameTransforms" => {
            let transform = object(
                "foxglove.FrameTransform",
                json!({ "timestamp": time, "parent_frame_id": text, "child_frame_id": text, "translation": vector, "rotation": turn }),
            );
            object(schema, json!({ "transforms": { "type": "array", "items": transform } }))
        }
        "foxglove.PointCloud" => {
            let pose = object("foxglove.Pose", json!({ "position": vector, "orientation": turn }));
            let field = object(
                "foxglove.PackedElementField",
                json!({ "name": text, "offset": integer, "type": { "title": "foxglove.NumericType", "oneOf": [
                    { "title": "UNKNOWN", "const": 0 }, { "title": "UINT8", "const": 1 }, { "title": "INT8", "const": 2 },
                    { "title": "UINT16", "const": 3 }, { "title": "INT16", "const": 4 }, { "title": "UINT32", "const": 5 },
                    { "title": "INT32", "const": 6 }, { "title": "FLOAT32", "const": 7 }, { "title": "FLOAT64", "const": 8 }] } }),
            );
            object(
                schema,
                json!({ "timestamp": time, "frame_id": text, "pose": pose, "point_stride": integer,
                    "fields": { "type": "array", "items": field }, "data": bytes }),
            )
        }
        "foxglove.RawImage" => object(
            schema,
            json!({ "timestamp": time, "frame_id": text, "width": integer, "height": integer, "encoding": text, "step": integer, "data": bytes }),
        ),
        "foxglove.Log" => object(
            schema,
            json!({ "timestamp": time, "level": { "title": "foxglove.LogLevel", "oneOf": [
                { "title": "UNKNOWN", "const": 0 }, { "title": "DEBUG", "const": 1 }, { "title": "INFO", "const": 2 },
                { "title": "WARNING", "const": 3 }, { "title": "ERROR", "const": 4 }, { "title": "FATAL", "const": 5 }] },
                "message": text, "name": text, "file": text, "line": integer }),
        ),
        _ => object(schema, json!({ "timestamp": time, "step": integer, "skill": text, "phase": text, "progress": number })),
    }
}
