//! What the steps hand to one another: data and what follows from it alone. No threads,
//! no policy; nothing here knows a step.

pub mod block;
pub mod coordinate_frame;
pub mod copc_plan;
pub mod counted_inputs;
pub mod counting_result;
pub mod finished_files;
pub mod inlier_region;
pub mod input_slice;
pub mod record_range;
pub mod runs;
