"""The daemon of one roadside unit: video in, stability flags of road segments out."""
