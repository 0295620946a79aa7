// The cost to go by Eq. 5 from every cell to one goal, in one thread, without walls and without routes: a
// circular array of buckets, each a twelfth of the mean edge wide (the fastest of the widths 1 to 1/16).
// A cell whose label improves is processed again, so the costs are exact.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

extern "C" void cost_to_go(const double* p_s, long rows, long cols, long goal_row, long goal_col, double w, double psi,
                           double* cost) {
    const long width = cols + 2, size = (rows + 2) * width, goal = (goal_row + 1) * width + goal_col + 1;
    const long offsets[8] = {1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1};
    const double step = (1 - w) * psi, extra = step * (std::sqrt(2.0) - 1);
    std::vector<double> straight(size, std::numeric_limits<double>::infinity()), label(straight);
    double sum = 0, greatest = 0;
    for (long row = 0; row < rows; row++)
        for (long col = 0; col < cols; col++) {
            const double edge = straight[(row + 1) * width + col + 1] = w * p_s[row * cols + col] + step;
            sum += edge;
            greatest = std::max(greatest, edge);
        }
    const double per_span = sum > 0 ? 12 * double(rows * cols) / sum : 1;
    std::vector<std::vector<int>> buckets(long((greatest + extra) * per_span) + 2);
    label[goal] = w * p_s[goal_row * cols + goal_col];
    long key = long(label[goal] * per_span), waiting = 1;
    for (buckets[key % buckets.size()].push_back(goal); waiting > 0; key++)
        for (auto& bucket = buckets[key % buckets.size()]; !bucket.empty();) {
            const long n = bucket.back();
            bucket.pop_back();
            waiting--;
            if (long(label[n] * per_span) != key) continue;  // already processed with a lower label
            for (int k = 0; k < 8; k++) {
                const long m = n + offsets[k];
                const double better = label[n] + (k < 4 ? 0 : extra) + straight[m];
                if (better >= label[m]) continue;
                label[m] = better;
                buckets[long(better * per_span) % buckets.size()].push_back(m);
                waiting++;
            }
        }
    for (long row = 0; row < rows; row++)
        for (long col = 0; col < cols; col++) {
            const double* at = &label[(row + 1) * width + col + 1];
            double least = std::numeric_limits<double>::infinity();
            for (int k = 0; k < 8; k++) least = std::min(least, at[offsets[k]] + (k < 4 ? 0 : extra));
            cost[row * cols + col] = least + step;
        }
    cost[goal_row * cols + goal_col] = 0;
}
