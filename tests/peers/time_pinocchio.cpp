// Times Pinocchio from C++: forward dynamics, its derivatives, and a rollout with its adjoint by state, efforts, damping and inertial
// parameters. Arguments: URDF, file with q, v, tau.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <vector>

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/multibody.hpp>

#include <pinocchio/serialization.hpp>

using Vector = Eigen::VectorXd;
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

static double clock_s() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void row(const char *name, int calls, const std::function<void()> &round) {
    round();
    double began = clock_s();
    round();
    int rounds = std::max(1, int(0.08 / std::max(clock_s() - began, 1e-7)));
    double least = 1e300;
    for (int k = 0; k < 9; k++) {
        began = clock_s();
        for (int i = 0; i < rounds; i++) round();
        least = std::min(least, (clock_s() - began) / (double(rounds) * calls));
    }
    std::printf("%.3f\t%s\n", least * 1e6, name);
    std::fflush(stdout);
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    pinocchio::Model model;
    model.loadFromText(argv[1]);
    const int n = model.nv, states = 256, steps = 1000;
    const double dt = 1e-3;
    Vector q(n), v(n), tau(n);
    std::ifstream in(argv[2]);
    for (Vector *x : {&q, &v, &tau})
        for (int i = 0; i < n; i++) in >> (*x)[i];
    pinocchio::Data data(model);
    std::srand(1);
    std::vector<Vector> qs, vs, taus;
    for (int i = 0; i < states; i++) {
        qs.push_back(q + Vector::Random(n));
        vs.push_back(Vector::Random(n));
        taus.push_back(5 * Vector::Random(n));
    }
    volatile double sink = 0;
    row("forward dynamics", states, [&] {
        for (int i = 0; i < states; i++) sink = pinocchio::aba(model, data, qs[i], vs[i], taus[i], pinocchio::Convention::WORLD)[0];
    });
    Rows by_q = Rows::Zero(n, n), by_v = by_q, by_tau = by_q;
    row("its derivatives by q, v, tau", states, [&] {
        for (int i = 0; i < states; i++) {
            pinocchio::computeABADerivatives(model, data, qs[i], vs[i], taus[i], by_q, by_v, by_tau);
            sink = by_q(0, 0);
        }
    });
    // A and B of v+ = v + h a, q+ = q + h v+, by hand.
    Rows A = Rows::Zero(2 * n, 2 * n), B = Rows::Zero(2 * n, n);
    Vector damping = Vector::Constant(n, 0.5);
    damping.tail(2).setConstant(1.0);
    row("free step + A, B", states, [&] {
        for (int i = 0; i < states; i++) {
            Vector effort = taus[i] - damping.cwiseProduct(vs[i]);
            pinocchio::computeABADerivatives(model, data, qs[i], vs[i], effort, by_q, by_v, by_tau);
            by_tau.triangularView<Eigen::StrictlyLower>() = by_tau.transpose();
            A.bottomLeftCorner(n, n).noalias() = dt * by_q;
            A.bottomRightCorner(n, n).noalias() = dt * by_v;
            A.bottomRightCorner(n, n).noalias() -= dt * by_tau * damping.asDiagonal();
            A.bottomRightCorner(n, n).diagonal().array() += 1.0;
            A.topRows(n).noalias() = dt * A.bottomRows(n);
            A.topLeftCorner(n, n).diagonal().array() += 1.0;
            B.bottomRows(n).noalias() = dt * by_tau;
            B.topRows(n).noalias() = dt * B.bottomRows(n);
            sink = A(0, 0) + B(0, 0);
        }
    });
    std::vector<Vector> Q(steps + 1, q), V(steps + 1, v), acceleration(steps, v);
    Vector effort(n), on_q(n), on_v(n), force(n), by_damping(n), by_inertia(10 * (model.njoints - 1));
    Eigen::MatrixXd by_effort(n, steps);
    row("1,000 free steps + gradient", 1, [&] {
        for (int k = 0; k < steps; k++) {
            effort = tau - damping.cwiseProduct(V[k]);
            acceleration[k] = pinocchio::aba(model, data, Q[k], V[k], effort, pinocchio::Convention::WORLD);
            V[k + 1] = V[k] + dt * acceleration[k];
            Q[k + 1] = Q[k] + dt * V[k + 1];
        }
        on_q = Q[steps];
        on_v.setZero();
        by_damping.setZero();
        by_inertia.setZero();
        for (int k = steps - 1; k >= 0; k--) {
            on_v += dt * on_q;
            effort = tau - damping.cwiseProduct(V[k]);
            pinocchio::computeABADerivatives(model, data, Q[k], V[k], effort, by_q, by_v, by_tau);
            // Only the upper triangle of the inverse mass matrix is written.
            force.noalias() = dt * (by_tau.selfadjointView<Eigen::Upper>() * on_v);
            by_effort.col(k) = force;
            by_damping -= force.cwiseProduct(V[k]);
            by_inertia.noalias() -= pinocchio::computeJointTorqueRegressor(model, data, Q[k], V[k], acceleration[k]).transpose() * force;
            on_q.noalias() += dt * (by_q.transpose() * on_v);
            on_v += dt * (by_v.transpose() * on_v).eval() - damping.cwiseProduct(force);
        }
        sink = by_effort(0, 0) + by_damping[0] + by_inertia[0];
    });
    (void)sink;
}
