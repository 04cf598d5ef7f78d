//! Lightmap atlas: unwrapping, coverage, reference points.
