//! Bayesian optimization of generation parameters: which are tried on a step, in which order, and on how many pixels.

mod acquisition;
mod bayesian;
mod candidates;
mod contenders;
mod deadline;
mod first_trial;
mod gamma_range;
mod gaussian_process;
mod grid;
mod limit_filling;
mod priors;
mod request;
mod surrogates;
#[cfg(test)]
mod tests;
mod time_screening;
mod with_margin;

pub use candidates::CandidateSet;
pub use gaussian_process::{GaussianProcess, Observation, param_point};
pub use grid::{GridAxis, SearchGrid};
pub use priors::CostPrior;
pub use request::{SearchRequest, SearchResult, search};
pub use with_margin::search_with_margin;
