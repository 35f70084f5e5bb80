/// Why an object could not be located.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PerceptionError {
    /// An image or a pose that comes with it cannot be used.
    #[error("image at {time:.3} s: {message}")]
    Image {
        /// Time of the image, s.
        time: f64,
        /// What is wrong with it.
        message: String,
    },
    /// The request cannot be answered as it stands.
    #[error("{object}: {message}")]
    Request {
        /// The object.
        object: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// The object may be there, but the camera cannot see the place: something hides it, or it lies outside the images.
    #[error(
        "{object}: not visible from here: of the places it may be in, {:.0} % are hidden or outside the images (at best {:.0} % of it would be seen)",
        hidden_share * 100.0, best_visible_share * 100.0
    )]
    NotVisible {
        /// The object.
        object: String,
        /// Share of the prior's places in which too little of the object would be seen, 0..1.
        hidden_share: f64,
        /// Greatest share of the object's camera-facing surface that would be seen in any of them, 0..1.
        best_visible_share: f64,
    },
    /// The camera sees the place, but nothing there looks like the object.
    #[error(
        "{object}: not found: at the best place only {:.0} % of its visible surface agrees with the images, and rays went through {:.0} % of it; check that it is there, within the prior's reach",
        inlier_share * 100.0, violated_share * 100.0
    )]
    NotFound {
        /// The object.
        object: String,
        /// At the best place found: share of the surface that should be seen and agrees, 0..1.
        inlier_share: f64,
        /// At the best place found: share of the surface that rays went through, 0..1.
        violated_share: f64,
    },
}
