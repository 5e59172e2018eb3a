//! Abiotic maps: what the site offers before any plant competes for it.
