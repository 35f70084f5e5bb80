"""Times Crocoddyl's FDDP on the reach of kernel/planning/benches/reach.rs, in one thread."""
import crocoddyl
import numpy as np
import pinocchio
from peer_timing import SCENE, model, row, version

KNOTS, DT = 100, 0.01
version(f"Crocoddyl {crocoddyl.__version__}")
arm = pinocchio.buildModelFromUrdf(model("panda_arm"))
state = crocoddyl.StateMultibody(arm)
drives = crocoddyl.ActuationModelFull(state)
x0 = np.concatenate([SCENE["free"]["q"][:7], np.zeros(7)])
goal = pinocchio.SE3(np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]]), np.array([0.62, 0, 0.6]))


def knot(pose, near, effort, dt):
    costs = crocoddyl.CostModelSum(state, drives.nu)
    residuals = {
        "pose": (crocoddyl.ResidualModelFramePlacement(state, arm.getFrameId("panda_hand"), goal, drives.nu), pose),
        "near": (crocoddyl.ResidualModelState(state, x0, drives.nu), near),
        "effort": (crocoddyl.ResidualModelControlGrav(state, drives.nu), effort),
    }
    for name, (residual, weight) in residuals.items():
        if weight > 0:
            costs.addCost(name, crocoddyl.CostModelResidual(state, residual), weight)
    return crocoddyl.IntegratedActionModelEuler(crocoddyl.DifferentialActionModelFreeFwdDynamics(state, drives, costs), dt)


problem = crocoddyl.ShootingProblem(x0, [knot(1.0, 1e-2, 1e-4, DT) for _ in range(KNOTS)], knot(1e3, 1e-1, 0.0, 0.0))
problem.nthreads = 1
states, controls = [x0] * (KNOTS + 1), problem.quasiStatic([x0] * KNOTS)
solver = crocoddyl.SolverFDDP(problem)
solver.th_stop = 1e-7
converged = solver.solve(states, controls, 200, False, 1e-9)
version(f"cost {solver.cost:.8f}, {solver.iter} iterations, converged: {converged}")
row("DDP, 7-dof reach, 100 knots, one iteration", solver.iter, lambda: solver.solve(states, controls, 200, False, 1e-9))
row("DDP, 7-dof reach, 100 knots, whole solve", 1, lambda: solver.solve(states, controls, 200, False, 1e-9))
