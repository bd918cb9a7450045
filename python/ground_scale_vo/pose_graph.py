"""Smoother over a pose graph: the steps of the odometry between nodes, and positions at some of them."""

import copy
import math
from typing import Any, NamedTuple, Tuple

import numpy as np

NODE_S = 0.5  # [s] between nodes with a fix, and twice this without
OUTLIER, MEDIAN = 11.8, 1.386  # quantiles of 99.7 % and 50 % of chi-square with two degrees of freedom
GNC_STEP = 1.4  # factor of the control parameter of graduated non-convexity
LEAST_USED = 0.5  # share of the fixes that agree with the odometry
CORRELATED_SHARE, CORRELATION_S = 0.5, 60.0  # of the variance of a fix that is shared by those of this time [s]
SHORT_S = 300.0  # [s]
LIKELY_SCALE = 0.03  # standard deviation of the logarithm of the scale, to choose between sets of fixes
REFLECTION_S = 10.0  # [s] of fixes that count as one until it is known which are outliers: reflections last
SLOPE_SIGMA, SLOPE_CORRELATION_S = 0.05, 60.0  # [rad] of the road against the horizontal, for so long the same
SCALE_WALK = 1e-4  # standard deviation by which the scale changes from a node to the next: load and tyres
LEAST_STEP = np.array([2e-3] * 3 + [2e-4] * 3)  # [m, rad] standard deviations of a step
SIZE = 10  # of the state of a node: position [m], rotation [rad], logarithm of the scale, correlated error of the fixes


class Odometry(NamedTuple):
    """Of the frames between the first and the last metric pose, in the axes of the first camera."""

    stamp: np.ndarray
    p: np.ndarray  # N x 3 [m]
    covariance: np.ndarray  # N x 6 x 6 of p and rotation as a left perturbation, without the error of the camera height
    up: np.ndarray  # N x 3
    height_sigma: float  # relative

    def at(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        flat = [np.interp(stamps, self.stamp, one) for one in values.reshape(len(values), -1).T]
        return np.stack(flat, -1).reshape(len(stamps), *values.shape[1:])


def skew(v: np.ndarray) -> np.ndarray:
    x, y, z, zero = *v.T, np.zeros(len(v))
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)


def exp(v: np.ndarray) -> np.ndarray:
    """N x 3 x 3 rotations of N rotation vectors."""
    angle = np.maximum(np.linalg.norm(v, axis=1), 1e-12)[:, None, None]
    k = skew(v) / angle
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def log_of_small(rotations: np.ndarray) -> np.ndarray:
    r = (rotations - rotations.transpose(0, 2, 1)) / 2
    return np.stack([r[:, 2, 1], r[:, 0, 2], r[:, 1, 0]], -1)


def scale_of(similarities: np.ndarray) -> float:
    """The logarithm of the scale of the nodes of Smoother.start()."""
    return float(np.median(np.log(np.maximum(np.hypot(similarities[:, 2], similarities[:, 3]), 1e-6))))


class Chain:
    """Normal equations of nodes of which each has terms with the next one: block-tridiagonal."""

    def __init__(self, nodes: int, size: int) -> None:
        self.d, self.u, self.g = np.zeros((nodes, size, size)), np.zeros((nodes - 1, size, size)), np.zeros((nodes, size))

    def add_steps(self, jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> None:
        """The Jacobian by a node; that by the next one is the identity."""
        self.u += jacobian.transpose(0, 2, 1) @ weight
        self.d[:-1] += self.u @ jacobian
        self.d[1:] += weight
        self.g[:-1] -= np.einsum("nij,nj->ni", self.u, residual)
        self.g[1:] -= np.einsum("nij,nj->ni", weight, residual)

    def add(self, node: np.ndarray, jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> None:
        """Of measurements: measured minus predicted, of which the Jacobian is given, with independent weights."""
        weighted = (jacobian * weight[:, :, None]).transpose(0, 2, 1)
        np.add.at(self.d, node, weighted @ jacobian)
        np.add.at(self.g, node, np.einsum("nij,nj->ni", weighted, residual))

    def solve(self) -> Tuple[np.ndarray, np.ndarray]:
        """The solution, and the marginal covariance of each node."""
        inverse, gain, x = np.empty_like(self.d), np.empty_like(self.u), self.g.copy()
        for k, block in enumerate(self.d):
            if k > 0:
                gain[k - 1] = inverse[k - 1] @ self.u[k - 1]
                block = block - self.u[k - 1].T @ gain[k - 1]
                x[k] -= gain[k - 1].T @ x[k - 1]
            inverse[k] = np.linalg.inv((block + block.T) / 2)
        x[-1] = inverse[-1] @ x[-1]
        for k in range(len(self.u) - 1, -1, -1):
            x[k] = inverse[k] @ x[k] - gain[k] @ x[k + 1]
            inverse[k] += gain[k] @ inverse[k + 1] @ gain[k].T
        return x, inverse


class Smoother:
    """The nodes, the steps of the odometry between them, and the fixes."""

    def __init__(self, odometry: Odometry, fixes: np.ndarray, stamp: np.ndarray, z: np.ndarray, sigma: np.ndarray) -> None:
        """fixes: their numbers; stamp [s], increasing; z: M x 3 positions, sigma: their standard deviations [m]."""
        self.odometry, self.fixes, self.fix_stamp, self.z, self.sigma = odometry, fixes, stamp, z, sigma
        self.shared_sigma = math.sqrt(CORRELATED_SHARE) * sigma
        start, end = odometry.stamp[0], odometry.stamp[-1]
        with_fix = stamp[np.unique(np.floor((stamp - start) / NODE_S), return_index=True)[1]]
        others = np.append(np.arange(start, end, 2 * NODE_S), end)
        neighbours = np.clip(np.searchsorted(stamp, others)[:, None] - [0, 1], 0, len(stamp) - 1)
        far = np.abs(others[:, None] - stamp[neighbours]).min(1) > NODE_S
        self.stamp = np.unique(np.concatenate([[start, end], with_fix, others[far]]))
        self.o, self.up = (odometry.at(self.stamp, values) for values in (odometry.p, odometry.up))
        self.step, self.dt = np.diff(self.o, axis=0), np.diff(self.stamp)
        covariance = odometry.at(self.stamp, odometry.covariance)
        f = np.tile(np.eye(6), (len(self.step), 1, 1))
        f[:, :3, 3:] = -skew(self.step)
        relative = covariance[1:] - f @ covariance[:-1] @ f.transpose(0, 2, 1)
        values, vectors = np.linalg.eigh(relative / np.outer(LEAST_STEP, LEAST_STEP))
        self.q = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 1), vectors) * np.outer(LEAST_STEP, LEAST_STEP)
        self.information = np.linalg.inv(self.q)
        after = np.clip(np.searchsorted(self.stamp, stamp), 1, len(self.stamp) - 1)
        self.node = after - (stamp - self.stamp[after - 1] < self.stamp[after] - stamp)
        self.arm = odometry.at(stamp, odometry.p) - self.o[self.node]
        share = np.abs(stamp - self.stamp[self.node]) / self.dt[after - 1]
        self.arm_variance = share[:, None] * np.trace(self.q[after - 1, :3, :3], axis1=1, axis2=2)[:, None] / 3
        self.start()

    def start(self) -> None:
        """The horizontal positions and a similarity transform at each node, in which the problem is linear: it needs no first
        guess. Truncated least squares, by graduated non-convexity (Yang et al. 2020) from all fixes, and in a short drive
        from all but a third, too: reflections at an end would turn the whole track."""
        axis = np.cross(self.up, [0, 0, 1])
        sine = np.linalg.norm(axis, axis=1, keepdims=True)
        level = exp(axis / np.maximum(sine, 1e-12) * np.arctan2(sine, self.up[:, 2:]))
        time = self.fix_stamp - self.fix_stamp[0]
        third = np.minimum(3 * time // max(time[-1], 1e-9), 2)
        left_out = range(-1, 3) if time[-1] < SHORT_S else [-1]
        for limit in OUTLIER * 4.0**np.arange(5):  # the receiver may state too small standard deviations
            found = [self.truncated_fit(level, limit, third != i) for i in left_out if (third != i).sum() > 1]
            _, x, self.is_used = min(found, key=lambda one: one[0])
            if self.is_used.mean() >= LEAST_USED:
                break
        angle = np.arctan2(x[:, 3], x[:, 2])
        self.c = exp(np.stack([0 * angle, 0 * angle, angle], -1)) @ level
        self.p = np.column_stack([x[:, :2], np.interp(self.stamp, self.stamp[self.node], self.z[:, 2])])
        self.scale = np.full(len(x), scale_of(x))
        self.shared = np.zeros((len(x), 3))

    def truncated_fit(self, level: np.ndarray, limit: float, chosen: np.ndarray) -> Tuple[float, np.ndarray, np.ndarray]:
        """The cost, the states of the nodes and which fixes are used. level: rotations of the nodes that make the road
        horizontal; limit: of a squared error in its variance; chosen: the fixes of the first solution."""
        step, arm = (np.einsum("nij,nj->ni", *one) for one in ((level[:-1], self.step), (level[self.node], self.arm)))
        jacobians = [np.tile(np.eye(4), (len(v), 1, 1)) for v in (step, arm)]
        for jacobian, v in zip(jacobians, (step, arm)):
            jacobian[:, :2, 2:] = np.stack([v[:, 0], -v[:, 1], v[:, 1], v[:, 0]], -1).reshape(-1, 2, 2)
        weight = np.zeros((len(step), 4, 4))
        for i in range(4):
            weight[:, i, i] = 3 / (np.einsum("nii->n", self.q[:, 3:, 3:] if i > 1 else self.q[:, :3, :3]) + 1e-6)
        steps = Chain(len(self.stamp), 4)
        steps.d[0, 2:, 2:] += 1e-6 * np.eye(2)
        steps.add_steps(-jacobians[0], weight, np.zeros((len(step), 4)))
        variance = self.sigma[:, 0]**2 + self.arm_variance[:, 0]
        first, last = (np.searchsorted(self.fix_stamp, self.fix_stamp + side * REFLECTION_S / 2) for side in (-1, 1))
        share = 1 / np.maximum(last - first, 1)
        weights, control = chosen.astype(float), 0.0
        while control < 100:
            chain = copy.deepcopy(steps)
            chain.add(self.node, jacobians[1][:, :2], np.tile(weights * share / variance, (2, 1)).T, self.z[:, :2])
            x, _ = chain.solve()
            predicted = np.einsum("nij,nj->ni", jacobians[1][:, :2], x[self.node])
            squares = ((self.z[:, :2] - predicted)**2).sum(1) / variance
            if control:
                control *= GNC_STEP
            else:
                control = limit / max(2 * squares.max() - limit, 1e-3 * limit) if chosen.all() else 1.0
            weights = np.clip(np.sqrt(limit * control * (control + 1) / np.maximum(squares, 1e-12)) - control, 0, 1)
        residual = x[1:] - np.einsum("nij,nj->ni", jacobians[0], x[:-1])
        cost = np.einsum("ni,nii,ni->", residual, weight, residual) + (share * np.minimum(squares, limit)).sum()
        return float(cost) + (scale_of(x) / LIKELY_SCALE)**2, x, weights > 0.5

    def refine(self, scale_sigma: float, iterations: int = 20) -> np.ndarray:
        """Gauss-Newton iterations over all states. Returns the covariances of the nodes."""
        covariance = np.zeros((len(self.stamp), SIZE, SIZE))
        for i in range(iterations):
            if i < iterations // 2:
                self.find_outliers(covariance)
            x, covariance = self.normal_equations(scale_sigma).solve()
            self.p += x[:, :3]
            self.c = exp(x[:, 3:6]) @ self.c
            self.scale += x[:, 6]
            self.shared += x[:, 7:]
            if np.abs(x[:, :6] / ([1e-3] * 3 + [1e-5] * 3)).max() < 1:
                break
        return covariance

    def scaled(self, node: Any, v: np.ndarray) -> np.ndarray:
        """N x 3 vectors of the odometry from these nodes, in the axes and the unit of the fixes."""
        return np.exp(self.scale[node, None]) * np.einsum("nij,nj->ni", self.c[node], v)

    def residuals(self) -> Tuple[np.ndarray, np.ndarray]:
        """M x 3 of the fixes, without their correlated error, and their variances."""
        predicted = self.p[self.node] + self.scaled(self.node, self.arm)
        return self.z - predicted - self.shared_sigma * self.shared[self.node], (1 - CORRELATED_SHARE) * self.sigma**2 + self.arm_variance

    def find_outliers(self, covariance: np.ndarray) -> None:
        """covariance: of the nodes, by the fixes that are used."""
        squares = (self.residuals()[0][:, :2]**2).sum(1)
        variance = self.sigma[:, 0]**2 + self.arm_variance[:, 0]
        inflation = max(1.0, float(np.median((squares / variance)[self.is_used])) / MEDIAN)
        predicted = np.where(self.is_used, 0, np.einsum("nii->n", covariance[self.node, :2, :2]) / 2)
        self.is_used = squares <= OUTLIER * inflation * (variance + predicted)

    def normal_equations(self, scale_sigma: float) -> Chain:
        n = len(self.stamp)
        chain = Chain(n, SIZE)
        chain.d[0, range(6, SIZE), range(6, SIZE)] = [scale_sigma**-2] + [1.0] * 3
        chain.g[0, 6:] = -np.append(self.scale[0] / scale_sigma**2, self.shared[0])
        # Steps of the odometry.
        v = self.scaled(np.s_[:-1], self.step)
        kept = np.exp(-self.dt / CORRELATION_S)
        jacobian = -np.tile(np.eye(SIZE), (n - 1, 1, 1))
        jacobian[:, :3, 3:6], jacobian[:, :3, 6] = skew(v), -v
        jacobian[:, range(7, SIZE), range(7, SIZE)] = -kept[:, None]
        weight = np.zeros((n - 1, SIZE, SIZE))
        turn = np.zeros((n - 1, 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = self.c[:-1]
        weight[:, :6, :6] = turn @ self.information @ turn.transpose(0, 2, 1)
        weight[:, 6, 6] = SCALE_WALK**-2
        weight[:, range(7, SIZE), range(7, SIZE)] = 1 / (1 - kept**2)[:, None]
        chain.add_steps(jacobian, weight, np.concatenate([
            np.diff(self.p, axis=0) - v, log_of_small(self.c[1:] @ self.c[:-1].transpose(0, 2, 1)), np.diff(self.scale)[:, None],
            self.shared[1:] - kept[:, None] * self.shared[:-1]], 1))
        # The road is horizontal but for its slope.
        up = np.einsum("nij,nj->ni", self.c, self.up)
        jacobian = np.zeros((n, 2, SIZE))
        jacobian[:, :, 3:6] = -skew(up)[:, :2]
        weight = np.gradient(self.stamp) / SLOPE_CORRELATION_S / SLOPE_SIGMA**2
        chain.add(np.arange(n), jacobian, np.tile(weight, (2, 1)).T, -up[:, :2])
        # Fixes.
        v = self.scaled(self.node, self.arm)
        jacobian = np.zeros((len(v), 3, SIZE))
        jacobian[:, :, :3], jacobian[:, :, 3:6], jacobian[:, :, 6] = np.eye(3), -skew(v), v
        jacobian[:, range(3), range(7, SIZE)] = self.shared_sigma
        residual, variance = self.residuals()
        inflation = max(1.0, float(np.median((residual[:, :2]**2 / variance[:, :2]).sum(1)[self.is_used])) / MEDIAN)
        weight = self.is_used[:, None] / (inflation * variance)
        weight[:, 2] /= (1 + residual[:, 2]**2 / variance[:, 2] / OUTLIER)**2  # Geman-McClure: altitudes
        chain.add(self.node, jacobian, weight, residual)
        return chain

    def frames(self, covariance: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Positions of the frames, by the odometry from the node before and from that after, and their covariances."""
        stamp = self.odometry.stamp
        after = np.clip(np.searchsorted(self.stamp, stamp), 1, len(self.stamp) - 1)
        share = ((stamp - self.stamp[after - 1]) / self.dt[after - 1])[:, None]
        before, behind = (self.p[k] + self.scaled(k, self.odometry.p - self.o[k]) for k in (after - 1, after))
        turn, share_of = self.c[after - 1], share[:, :, None]
        between = share_of * (1 - share_of) * (turn @ self.q[after - 1, :3, :3] @ turn.transpose(0, 2, 1))
        return ((1 - share) * before + share * behind,
                (1 - share_of) * covariance[after - 1, :3, :3] + share_of * covariance[after, :3, :3] + between)
