//! Readers of recorded volumes and time series.
