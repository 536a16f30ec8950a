/* Hands fields of a running OpenFOAM case to a generator-node: a function object, for any solver and any mesh.
 *
 *     lamina
 *     {
 *         type          lamina;
 *         libs          (laminaFunctionObject);
 *         fields        (alpha.water U);   // volScalarFields and volVectorFields; the first is shown first
 *         points        (96 48 64);        // of the grid that is laid over the mesh
 *         box           (0 0 0) (1 1 1);   // default: what encloses the mesh at the first step
 *         writeControl  timeStep;          // when a step is pushed
 *         writeInterval 5;
 *     }
 *
 * A cell-centered grid lies over the box. Each rank interpolates (cellPoint) at the grid's points inside its own cells and sends the
 * values to the rank that has their slab of the grid along z, which pushes it as one brick. Points in no cell are missing values (NaN).
 * With each step go residual_FIELD, the initial residuals of the scalar fields solved for last, and deltaT: for the page, triggers and alerts.
 * The node's address is that of LAMINA_GENERATOR. A node that is away costs a warning, never the run. */
#include "addToRunTimeSelectionTable.H"
#include "boundBox.H"
#include "fvMeshFunctionObject.H"
#include "indexedOctree.H"
#include "interpolationCellPoint.H"
#include "lamina.h"
#include "solverPerformance.H"
#include "treeDataCell.H"
#include "volFields.H"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace Foam
{
namespace functionObjects
{

class lamina : public fvMeshFunctionObject
{
    wordList fields_;
    FixedList<label, 3> points_;
    autoPtr<boundBox> box_;

    lamina_client* client_ = nullptr;
    bool open_ = false;
    uint64_t step_ = 0;

    //- Whether the cells that hold the grid's points have to be found again
    bool moved_ = true;
    //- For each rank, the weights at the points of its slab that lie in this rank's cells
    std::vector<std::vector<cellPointWeight>> weights_;
    //- From each rank, the places of its values in this rank's slab
    List<List<label>> places_;

    //- First plane along z of a rank's slab
    label first(const label rank) const
    {
        return label(int64_t(points_[2])*rank/Pstream::nProcs());
    }

    vector spacing() const
    {
        return cmptDivide(box_->span(), vector(points_[0], points_[1], points_[2]));
    }

    //- Finds the cells of the grid's points. On all ranks at once
    void locate()
    {
        const label ranks = Pstream::nProcs();
        const vector d = spacing();
        const boundBox own(mesh_.points(), false);
        const indexedOctree<treeDataCell>& tree = mesh_.cellTree();
        weights_.clear();
        weights_.resize(ranks);
        List<List<label>> sent(ranks);

        FixedList<label, 3> low, high;
        for (direction a = 0; a < 3; ++a)
        {
            low[a] = max(label(0), label(std::floor((own.min()[a] - box_->min()[a])/d[a] - 0.5)));
            high[a] = min(points_[a], label(std::ceil((own.max()[a] - box_->min()[a])/d[a] + 0.5)));
        }
        for (label rank = 0; rank < ranks; ++rank)
        {
            DynamicList<label> places;
            for (label k = max(low[2], first(rank)); k < min(high[2], first(rank + 1)); ++k)
            {
                for (label j = low[1]; j < high[1]; ++j)
                {
                    for (label i = low[0]; i < high[0]; ++i)
                    {
                        const vector x = box_->min() + cmptMultiply(vector(i + 0.5, j + 0.5, k + 0.5), d);
                        const label cell = tree.findInside(x);
                        if (cell != -1)
                        {
                            weights_[rank].emplace_back(mesh_, x, cell);
                            places.append(i + points_[0]*(j + points_[1]*(k - first(rank))));
                        }
                    }
                }
            }
            sent[rank].transfer(places);
        }
        Pstream::exchange<List<label>, label>(sent, places_);
        moved_ = false;
    }

    //- One slab for each component of a field
    template<class Type>
    void sample(const word& name, std::vector<std::vector<float>>& slabs) const
    {
        const auto& field = mesh_.lookupObject<GeometricField<Type, fvPatchField, volMesh>>(name);
        const interpolationCellPoint<Type> interpolated(field);
        List<List<Type>> sent(Pstream::nProcs()), received;
        forAll(sent, rank)
        {
            sent[rank].resize(weights_[rank].size());
            forAll(sent[rank], i)
            {
                sent[rank][i] = interpolated.interpolate(weights_[rank][i]);
            }
        }
        Pstream::exchange<List<Type>, Type>(sent, received);
        const label rank = Pstream::myProcNo();
        const size_t slab = size_t(points_[0])*points_[1]*(first(rank + 1) - first(rank));
        for (direction c = 0; c < pTraits<Type>::nComponents; ++c)
        {
            slabs.emplace_back(slab, std::numeric_limits<float>::quiet_NaN());
            forAll(received, from)
            {
                forAll(received[from], i)
                {
                    slabs.back()[places_[from][i]] = float(component(received[from][i], c));
                }
            }
        }
    }

    bool isVector(const word& name) const
    {
        return mesh_.foundObject<volVectorField>(name);
    }

    void open()
    {
        open_ = true;
        if (!box_.valid())
        {
            // With the reduction of its corners: the box of all ranks.
            box_.reset(new boundBox(mesh_.points(), true));
        }
        std::vector<std::string> names;
        for (const word& field : fields_)
        {
            if (!isVector(field) && !mesh_.foundObject<volScalarField>(field))
            {
                FatalErrorInFunction << field << " is no field of this solver; there are " << mesh_.sortedNames<volScalarField>()
                    << " and " << mesh_.sortedNames<volVectorField>() << exit(FatalError);
            }
            // A dot within a name would be an operator in an expression.
            std::string name = field;
            std::replace(name.begin(), name.end(), '.', '_');
            for (const char* component : {".x", ".y", ".z"})
            {
                names.push_back(isVector(field) ? name + component : name);
                if (!isVector(field)) break;
            }
        }
        std::vector<lamina_field> more;
        for (size_t i = 1; i < names.size(); ++i)
        {
            more.push_back({names[i].c_str(), LAMINA_F32});
        }
        const std::string shown = "magnitude(" + names[0].substr(0, names[0].find('.')) + ")";
        const std::string generator = getEnv("LAMINA_GENERATOR");
        const std::string name = time_.globalCaseName();
        const vector d = spacing();
        lamina_options run{};
        run.generator = generator.empty() ? nullptr : generator.c_str();
        run.name = name.c_str();
        run.field = names[0].c_str();
        run.type = LAMINA_F32;
        run.rank = Pstream::myProcNo();
        run.ranks = Pstream::nProcs();
        run.more_fields = more.data();
        run.more_field_count = more.size();
        run.shown = isVector(fields_[0]) ? shown.c_str() : nullptr;
        for (direction a = 0; a < 3; ++a)
        {
            run.dims[a] = points_[a];
            run.spacing[a] = d[a];
            run.origin[a] = box_->min()[a] + d[a]/2;
        }
        if (lamina_connect(&run, &client_) < 0)
        {
            Pout<< "lamina: not shown: " << lamina_error() << endl;
        }
    }

public:

    TypeName("lamina");

    lamina(const word& name, const Time& time, const dictionary& dict)
    :
        fvMeshFunctionObject(name, time, dict)
    {
        read(dict);
    }

    virtual ~lamina()
    {
        lamina_summary ended;
        lamina_close(client_, &ended);
        if (client_)
        {
            Info<< "lamina: pushed " << label(ended.pushed) << ", dropped " << label(ended.dropped) << ", lost "
                << label(ended.lost) << endl;
        }
    }

    //- The controls; of a running case all but fields, points and box may change
    virtual bool read(const dictionary& dict)
    {
        fvMeshFunctionObject::read(dict);
        if (!open_)
        {
            fields_ = dict.get<wordList>("fields");
            points_ = dict.get<FixedList<label, 3>>("points");
            if (fields_.empty() || *std::min_element(points_.begin(), points_.end()) < 2)
            {
                FatalIOErrorInFunction(dict) << "fields (..) names none, or points (nx ny nz) are fewer than 2"
                    << exit(FatalIOError);
            }
            if (dict.found("box"))
            {
                box_.reset(new boundBox(dict.lookup("box")));
            }
        }
        return true;
    }

    virtual bool execute()
    {
        return true;
    }

    //- Pushes a step, if the node does not go without it: all ranks sample what any of them pushes
    virtual bool write()
    {
        if (!open_)
        {
            open();
        }
        // From the question on time counts as a cost of watching: to wait for slower ranks is none.
        returnReduce(true, orOp<bool>());
        const int32_t wanted = client_ ? lamina_wants(client_, step_) : 0;
        if (wanted < 0)
        {
            notShown();
        }
        if (returnReduce(wanted > 0, orOp<bool>()))
        {
            push(wanted > 0);
        }
        ++step_;
        return true;
    }

    //- Tells the numbers that go with a step
    void diagnose() const
    {
        lamina_diagnostic(client_, "deltaT", time_.deltaTValue());
        const dictionary& solved = mesh_.solverPerformanceDict();
        for (const word& field : solved.toc())
        {
            if (mesh_.foundObject<volScalarField>(field))
            {
                std::string name = "residual_" + field;
                std::replace(name.begin(), name.end(), '.', '_');
                const List<solverPerformance> performance(solved.lookup(field));
                lamina_diagnostic(client_, name.c_str(), performance.first().initialResidual());
            }
        }
    }

    //- Samples the fields; hands them over where this rank's part of the step is wanted
    void push(const bool wanted)
    {
        if (moved_)
        {
            locate();
        }
        std::vector<std::vector<float>> slabs;
        for (const word& field : fields_)
        {
            isVector(field) ? sample<vector>(field, slabs) : sample<scalar>(field, slabs);
        }
        const label rank = Pstream::myProcNo();
        std::vector<lamina_array> more;
        for (size_t i = 1; i < slabs.size(); ++i)
        {
            more.push_back({slabs[i].data(), LAMINA_F32});
        }
        lamina_brick brick{};
        brick.start[2] = first(rank);
        brick.dims[0] = points_[0];
        brick.dims[1] = points_[1];
        brick.dims[2] = first(rank + 1) - first(rank);
        brick.voxels = slabs[0].data();
        brick.more = more.empty() ? nullptr : more.data();
        if (wanted && Pstream::master())
        {
            diagnose();
        }
        if (wanted && lamina_push_bricks(client_, step_, time_.value(), &brick, brick.dims[2] ? 1 : 0) < 0)
        {
            notShown();
        }
    }

    void notShown() const
    {
        Pout<< "lamina: step " << label(step_) << " not shown: " << lamina_error() << endl;
    }

    virtual void updateMesh(const mapPolyMesh&)
    {
        moved_ = true;
    }

    virtual void movePoints(const polyMesh&)
    {
        moved_ = true;
    }
};

defineTypeNameAndDebug(lamina, 0);
addToRunTimeSelectionTable(functionObject, lamina, dictionary);

} // End namespace functionObjects
} // End namespace Foam
