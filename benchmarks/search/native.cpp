// Native OMPL on the queries of standard input: RRTConnect, then simplify, stock discrete validator.
//
// Every line is a command; numbers are in metres and radians, in the frame of the field.
//   limit <s>
//   field <file> <columns> <rows> <step> <x> <y>     float32 distances at nodes, row by row from (x, y)
//   footprint <n> <x> <y> ...                        a convex outline, counter-clockwise
//   space SE2|ReedsShepp|Dubins <turning radius> <resolution>
//   query <x> <y> <theta> <x> <y> <theta>
//     -> solved, seconds to the first path, seconds in all, length of the origin's way, n, n states
//   motions <n> <pairs of poses>                     -> seconds that checking them all takes, how many are free
//
// Each is done in a process of its own: an assertion of Dubins words in Debian's library fails on some states. Then
// it is done again with another seed, and the time adds up.
#include <sys/wait.h>
#include <unistd.h>

#include <ompl/base/DiscreteMotionValidator.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/spaces/DubinsStateSpace.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iostream>
#include <string>
#include <vector>

namespace ob = ompl::base;
namespace og = ompl::geometric;

// Distances to the nearest obstacle at the nodes of a grid, negative inside; linear between them.
struct Field {
    int columns = 0, rows = 0;
    double step = 1, x = 0, y = 0;
    std::vector<float> nodes;

    double at(double px, double py) const {
        const double u = (px - x) / step, v = (py - y) / step;
        if (!(u >= 0 && v >= 0 && u < columns - 1 && v < rows - 1)) return -1;
        const int i = int(u), j = int(v);
        const double a = u - i, b = v - j;
        const float *n = &nodes[std::size_t(j) * columns + i];
        return (1 - b) * ((1 - a) * n[0] + a * n[1]) + b * ((1 - a) * n[columns] + a * n[columns + 1]);
    }
};

// The outline as points a step apart, and the discs round its middle that settle most poses alone.
struct Footprint {
    double x = 0, y = 0, inner = 0, outer = 0, gap = 1;
    std::vector<std::pair<double, double>> points;

    void make(const std::vector<std::pair<double, double>> &outline, double step) {
        points.clear();
        double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
        for (auto [px, py] : outline)
            x0 = std::min(x0, px), x1 = std::max(x1, px), y0 = std::min(y0, py), y1 = std::max(y1, py);
        x = (x0 + x1) / 2, y = (y0 + y1) / 2, inner = 1e9, outer = 0, gap = step;
        for (std::size_t k = 0; k < outline.size(); ++k) {
            const auto [ax, ay] = outline[k];
            const auto [bx, by] = outline[(k + 1) % outline.size()];
            const double length = std::hypot(bx - ax, by - ay);
            const int n = std::max(1, int(std::ceil(length / step)));
            for (int i = 0; i < n; ++i) points.emplace_back(ax + (bx - ax) * i / n, ay + (by - ay) * i / n);
            inner = std::min(inner, ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length);
            outer = std::max(outer, std::hypot(ax - x, ay - y));
        }
    }

    bool free(const Field &field, double px, double py, double theta) const {
        const double c = std::cos(theta), s = std::sin(theta);
        const double middle = field.at(px + c * x - s * y, py + s * x + c * y);
        if (middle > outer) return true;
        if (middle < inner) return false;
        for (std::size_t k = 0; k < points.size();) {
            const auto [bx, by] = points[k];
            const double d = field.at(px + c * bx - s * by, py + s * bx + c * by);
            if (!(d > 0)) return false;
            // What is within d of this point along the outline is free too.
            k += std::max(1, int(d / gap));
        }
        return true;
    }
};

static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Problem {
    Field field;
    Footprint footprint;
    double limit = 2;
    std::string kind;
    double radius = 1, resolution = 0.1;
    ob::StateSpacePtr space;
    ob::SpaceInformationPtr information;

    void set_up() {
        ob::RealVectorBounds bounds(2);
        bounds.setLow(0, field.x), bounds.setHigh(0, field.x + (field.columns - 1) * field.step);
        bounds.setLow(1, field.y), bounds.setHigh(1, field.y + (field.rows - 1) * field.step);
        if (kind == "ReedsShepp")
            space = std::make_shared<ob::ReedsSheppStateSpace>(radius);
        else if (kind == "Dubins")
            space = std::make_shared<ob::DubinsStateSpace>(radius);
        else
            space = std::make_shared<ob::SE2StateSpace>();
        space->as<ob::SE2StateSpace>()->setBounds(bounds);
        information = std::make_shared<ob::SpaceInformation>(space);
        information->setStateValidityChecker([this](const ob::State *state) {
            const auto *s = state->as<ob::SE2StateSpace::StateType>();
            return footprint.free(field, s->getX(), s->getY(), s->getYaw());
        });
        information->setStateValidityCheckingResolution(resolution / space->getMaximumExtent());
        information->setup();
    }

    ob::ScopedState<> state(const double *pose) const {
        ob::ScopedState<> s(space);
        s[0] = pose[0], s[1] = pose[1], s[2] = std::remainder(pose[2], 2 * M_PI);
        return s;
    }

    void query(const double *start, const double *goal, double begin) {
        auto definition = std::make_shared<ob::ProblemDefinition>(information);
        definition->setStartAndGoalStates(state(start), state(goal));
        og::RRTConnect planner(information);
        planner.setProblemDefinition(definition);
        planner.setup();
        const bool solved = planner.solve(ob::timedPlannerTerminationCondition(limit)) ==
                            ob::PlannerStatus::EXACT_SOLUTION;
        const double first = now() - begin;
        if (!solved) {
            std::printf("0 %.9g %.9g 0 0\n", first, first);
            return;
        }
        auto &path = *definition->getSolutionPath()->as<og::PathGeometric>();
        og::PathSimplifier(information).simplify(path, limit);
        const double total = now() - begin;
        auto fine = path;
        fine.interpolate(std::max<unsigned>(path.getStateCount(), unsigned(path.length() / 0.05) + 2));
        double length = 0;
        for (std::size_t k = 1; k < fine.getStateCount(); ++k) {
            const auto *a = fine.getState(k - 1)->as<ob::SE2StateSpace::StateType>();
            const auto *b = fine.getState(k)->as<ob::SE2StateSpace::StateType>();
            length += std::hypot(b->getX() - a->getX(), b->getY() - a->getY());
        }
        std::printf("1 %.9g %.9g %.9g %zu", first, total, length, path.getStateCount());
        for (const auto *state : path.getStates()) {
            const auto *s = state->as<ob::SE2StateSpace::StateType>();
            std::printf(" %.17g %.17g %.17g", s->getX(), s->getY(), s->getYaw());
        }
        std::printf("\n");
    }

    void motions(const std::vector<double> &poses) {
        std::vector<ob::ScopedState<>> states;
        for (std::size_t k = 0; k < poses.size(); k += 3) states.push_back(state(&poses[k]));
        std::size_t free = 0;
        const double begin = now();
        for (std::size_t k = 0; k < states.size(); k += 2)
            free += information->checkMotion(states[k].get(), states[k + 1].get());
        std::printf("%.9g %zu\n", now() - begin, free);
    }
};

// A task in a process that may abort, with other seeds until it does not, or `otherwise` for an answer.
static void guarded(const std::function<void(double)> &task, double limit, const char *otherwise) {
    const double begin = now();
    for (std::uint_fast32_t seed = 1; now() - begin < limit; ++seed) {
        const pid_t child = fork();
        if (child == 0) {
            std::fclose(stderr);
            ompl::RNG::setSeed(seed);
            task(begin);
            std::fflush(stdout);
            _exit(0);
        }
        int status = 0;
        waitpid(child, &status, 0);
        if (WIFEXITED(status)) return;
    }
    std::fputs(otherwise, stdout);
    std::fflush(stdout);
}

int main() {
    ompl::msg::noOutputHandler();
    Problem problem;
    std::string word;
    while (std::cin >> word) {
        if (word == "limit") {
            std::cin >> problem.limit;
        } else if (word == "field") {
            Field &f = problem.field;
            std::string file;
            std::cin >> file >> f.columns >> f.rows >> f.step >> f.x >> f.y;
            f.nodes.resize(std::size_t(f.columns) * f.rows);
            std::ifstream(file, std::ios::binary)
                .read(reinterpret_cast<char *>(f.nodes.data()), std::streamsize(f.nodes.size() * sizeof(float)));
        } else if (word == "footprint") {
            std::size_t n;
            std::cin >> n;
            std::vector<std::pair<double, double>> outline(n);
            for (auto &[x, y] : outline) std::cin >> x >> y;
            problem.footprint.make(outline, problem.field.step);
        } else if (word == "space") {
            std::cin >> problem.kind >> problem.radius >> problem.resolution;
            problem.set_up();
        } else if (word == "query") {
            double poses[6];
            for (double &v : poses) std::cin >> v;
            const auto task = [&](double begin) { problem.query(poses, poses + 3, begin); };
            guarded(task, problem.limit, "0 inf inf 0 0\n");
        } else if (word == "motions") {
            std::size_t n;
            std::cin >> n;
            std::vector<double> poses(6 * n);
            for (double &v : poses) std::cin >> v;
            guarded([&](double) { problem.motions(poses); }, 1, "nan 0\n");
        } else {
            std::fprintf(stderr, "unknown command %s\n", word.c_str());
            return 2;
        }
    }
}
