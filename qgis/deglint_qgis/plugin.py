"""The provider and its algorithms, built from the tables of `commands`."""

from __future__ import annotations

from pathlib import Path

from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPoint,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorDestination,
    QgsProcessingProvider,
)

from .commands import ALGORITHMS, arguments, executable, run


def _defined(p):
    """A parameter of the table as QGIS has it."""
    optional = not p.needed
    shown = optional and p.name not in ("FLAGS", "AMOUNT", "OBJECTS")
    if p.kind == "raster":
        return QgsProcessingParameterRasterLayer(p.name, p.title)
    if p.kind == "file":
        return QgsProcessingParameterFile(p.name, p.title, optional=True)
    if p.kind == "choice":
        return QgsProcessingParameterEnum(p.name, p.title, list(p.choices), defaultValue=p.choices.index(p.default))
    if p.kind == "number":
        double = QgsProcessingParameterNumber.Double
        return QgsProcessingParameterNumber(p.name, p.title, double, p.default, optional=True, minValue=0.0)
    if p.kind == "point":
        return QgsProcessingParameterPoint(p.name, p.title)
    if p.kind == "raster out":
        return QgsProcessingParameterRasterDestination(p.name, p.title, optional=optional, createByDefault=shown)
    if p.kind == "vector out":
        return QgsProcessingParameterVectorDestination(p.name, p.title, optional=True, createByDefault=shown)
    if p.kind == "file out":
        return QgsProcessingParameterFileDestination(p.name, p.title, p.filter)
    return QgsProcessingParameterString(p.name, p.title, p.default, optional=True)


class CommandAlgorithm(QgsProcessingAlgorithm):
    """An algorithm of the table, run as a command."""

    def __init__(self, key):
        super().__init__()
        self._key, self._table = key, ALGORITHMS[key]

    def createInstance(self):  # noqa: N802
        """Another one of the same."""
        return CommandAlgorithm(self._key)

    def name(self):
        """Identifier."""
        return self._key

    def displayName(self):  # noqa: N802
        """Title."""
        return self._table.title

    def shortHelpString(self):  # noqa: N802
        """Help."""
        return f"{self._table.help}\n\nRuns: {self._table.program} {self._table.command}"

    def initAlgorithm(self, _configuration=None):  # noqa: N802
        """Define the parameters."""
        for parameter in self._table.parameters:
            self.addParameter(_defined(parameter))

    def _value(self, p, parameters, context):
        if p.kind == "raster":
            return self.parameterAsRasterLayer(parameters, p.name, context).source()
        if p.kind == "choice":
            return p.choices[self.parameterAsEnum(parameters, p.name, context)]
        if p.kind == "number":
            return None if parameters.get(p.name) is None else self.parameterAsDouble(parameters, p.name, context)
        if p.kind == "point":
            point = self.parameterAsPoint(parameters, p.name, context, QgsCoordinateReferenceSystem("EPSG:4326"))
            return point.x(), point.y()
        if p.kind.endswith("out"):
            return self.parameterAsOutputLayer(parameters, p.name, context) if p.kind != "file out" else (
                self.parameterAsFileOutput(parameters, p.name, context))  # fmt: skip
        return self.parameterAsString(parameters, p.name, context)

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802
        """Run the command."""
        values = {p.name: self._value(p, parameters, context) for p in self._table.parameters}
        try:
            command = [*executable(self._table.program), *arguments(self._key, values)]
        except FileNotFoundError as error:
            raise QgsProcessingException(str(error)) from error
        feedback.pushCommandInfo(" ".join(command))
        said = []

        def say(line):
            said.append(line)
            feedback.pushInfo(line)

        code, out = run(command, say, feedback.setProgress, feedback.isCanceled)
        if code:
            raise QgsProcessingException(said[-1] if said else f"{command[0]} failed with exit code {code}")
        feedback.pushInfo(out)
        if self._key == "info":
            Path(values["OUTPUT"]).write_text(out, encoding="utf-8")
        return {p.name: values[p.name] for p in self._table.parameters if p.kind.endswith("out") and values[p.name]}


class Provider(QgsProcessingProvider):
    """Everything of the table."""

    def id(self):
        """Identifier."""
        return "deglint"

    def name(self):
        """Title."""
        return "deglint"

    def loadAlgorithms(self):  # noqa: N802
        """Offer the algorithms."""
        for key in ALGORITHMS:
            self.addAlgorithm(CommandAlgorithm(key))


class Plugin:
    """Adds the provider to QGIS, with windows or without."""

    def __init__(self):
        self._provider = None

    def initProcessing(self):  # noqa: N802
        """Add the provider; qgis_process calls this alone."""
        self._provider = Provider()
        QgsApplication.processingRegistry().addProvider(self._provider)

    def initGui(self):  # noqa: N802
        """Add the provider."""
        self.initProcessing()

    def unload(self):
        """Take it away."""
        QgsApplication.processingRegistry().removeProvider(self._provider)
