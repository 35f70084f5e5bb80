use std::path::PathBuf;

/// Why no model could be made.
#[derive(Debug, thiserror::Error)]
pub enum ModellingError {
    /// There is too little to look at.
    #[error(
        "the cloud holds {finite} points with usable coordinates ({total} in all); {least} are needed; look from nearer, or give more views"
    )]
    TooFew {
        /// Points that are finite.
        finite: usize,
        /// All points.
        total: usize,
        /// How many are needed.
        least: usize,
    },
    /// What lies in one plane or line has no parts.
    #[error("all points lie {shape}, so no solid can be made of them; look from further sides")]
    Flat {
        /// In a plane, on a line, in one place.
        shape: &'static str,
    },
    /// The size is none that an object of a household has.
    #[error("the cloud is {diagonal:.3e} m across; this is no object for an arm: is it in metres?")]
    Size {
        /// Its diagonal, m.
        diagonal: f64,
    },
    /// There seem to be several objects.
    #[error("there seem to be {count} objects, with {} points; give the cloud of one", shares.join(", "))]
    Several {
        /// How many.
        count: usize,
        /// Points of each.
        shares: Vec<String>,
    },
    /// The camera's description does not fit.
    #[error("the camera poses: {message}")]
    Camera {
        /// What is wrong.
        message: String,
    },
    /// The weights of the networks are not what the program expects.
    #[error("the networks' weights: {message}")]
    Weights {
        /// What is wrong.
        message: String,
    },
    /// The model could not be put together or written.
    #[error(transparent)]
    Model(#[from] sagci_model::ModelError),
    /// A cloud could not be written.
    #[error(transparent)]
    Cloud(#[from] sagci_cloud::CloudError),
    /// A file cannot be written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}
