"""Study: dial, trio and the intersection's dial on merge and roundabout."""
